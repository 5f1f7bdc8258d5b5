"""A periodic sheet kicked at random: one run that excites every wave of the lattice, with snapshots of all spheres.

The scene is the declared one with noise (``start.noise``) in place of its wave, small enough to stay linear, and it is
run as any scene. The case ``dispersion`` reads what comes out.
"""

from pathlib import Path

import numpy as np

from granular_lmp.accuracy.tolerance import resume, run
from granular_lmp.crystal.lattices import HEXAGONAL, lattice_constant, unit_lattice
from granular_lmp.crystal.modes import highest_frequency
from granular_lmp.errors import EffectError, SceneError
from granular_lmp.lammps.outputs import SCENE, STATUS, writable
from granular_lmp.problem import prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.record import Record, read_status

SHEET_RECORD = "sheet.npz"
FEWEST_SAMPLES = 8  # records after tau = 0; with fewer the window of a spectrum leaves hardly any data

# What a scene may say that is kicked: of anything else, the record does not tell its reader
_HAS = frozenset({"name", "sphere", "packing", "wave", "time", "effects", "output"})
_EFFECTS = frozenset({"adhesion", "shear", "rotation", "tracking", "width"})
# Guards of a sheet that is not linear any more, and the reasons
_LINEAR = {"largest_slip": "contacts slid", "open_contacts": "contacts opened"}


def kicked(scene: Scene, seed: int = 0) -> Scene:
    """Return the scene with noise in place of its wave: ẋ, ẏ and Rθ̇ uniform in ±½ D0/t0, no displacement.

    Every mode gets the same mean energy, and the sheet has no momentum, which would carry it away. Effects and size are
    those of the declared scene, and snapshots of all spheres are taken at each sample.

    Raises
    ------
    SceneError
        If spheres do not turn, or an effect is on that the theory of the sheet leaves out.
    """
    problem = prepare(scene)
    if not problem.on["rotation"]:
        raise SceneError(
            "effects.rotation is off: must be on for a sheet that is kicked, for instance with wave.mode = TR"
        )
    if others := [name for name, on in problem.on.items() if on and name not in _EFFECTS]:
        raise SceneError(
            f"effects.{others[0]} is on: must be off for a sheet that is kicked, whose linear theory leaves it out"
        )
    return problem.scene.with_values(
        {
            "wave.form": "none",
            "start.noise": problem.scene.displacement_amplitude / scene.sphere.time_scale / 2,
            "start.seed": seed,
            "output.particles": scene.time.sample,
            "time.allow_echo": True,
        }
    )


def run_kicked(
    scene: Scene, folder: str | Path, seed: int = 0, *, force: bool = False, kernel: bool | None = None
) -> Path:
    """Kick the sheet of a scene, run it, and return the path of ``sheet.npz``.

    A run of the same sheet that was stopped is continued, and one that is finished is read.

    Parameters
    ----------
    scene : Scene
        Periodic sheet. The amplitude D0 of its wave sets the velocities, its times the duration and the interval of the
        snapshots.
    folder : path
        Run folder, which is created, of the scene that `kicked` returns.
    seed : int
        Seed of the random velocities.
    force : bool
        Run again in an existing folder.
    kernel : bool, optional
        As in `granular_lmp.run`.

    Returns
    -------
    Path
        Path of ``sheet.npz`` with ``tau`` (T,); ``velocity`` (T, N, 3): ẋ, ẏ, Rθ̇ in D0/t0; ``position`` (N, 2) at rest
        and ``box`` (2,), in lattice constants; ``poisson_ratio``, ``overlap_ratio``, ``contact_force`` in N and
        ``prestress``, its share of the force that holds a contact; ``effects``, the names of the effects that are on.

    Raises
    ------
    SceneError
        If the lattice is not hexagonal, the scene has fixed ends, monitors or a tolerance, its columns are not a
        multiple of 3, spheres do not turn, an effect is on that its theory leaves out, or its records are too few or
        too far apart.
    RunFolderError
        If the folder holds anything else (without `force`), or the sheet of a run that is finished.
    EffectError
        If contacts slid or opened because the velocities were too large.
    LammpsMissingError, LammpsError, RunInterrupted
        As in `granular_lmp.run`.
    """
    _refuse_unfit(scene)
    sheet, folder = kicked(scene, seed), Path(folder)
    if not force and _has_begun(sheet, folder):
        record = Record.load(folder) if read_status(folder)["status"] == "finished" else resume(folder)
    else:
        record = run(sheet, folder, force=force, kernel=kernel)
    return write_sheet(record)


def _has_begun(sheet: Scene, folder: Path) -> bool:
    """Return whether a folder holds a run of a sheet, and not yet what `write_sheet` writes."""
    declared = folder / SCENE
    if (folder / SHEET_RECORD).exists() or not ((folder / STATUS).is_file() and declared.is_file()):
        return False
    return declared.read_text(encoding="utf-8") == prepare(sheet).scene.to_toml()


def write_sheet(record: Record) -> Path:
    """Write ``sheet.npz`` beside the record of a kicked sheet, whose run may have been continued; return its path.

    Raises
    ------
    EffectError
        If contacts slid or opened because the velocities were too large.
    """
    folder = record.folder
    for guard, what in _LINEAR.items():
        if not record.info["guards"].get(guard, {}).get("quiet", True):
            raise EffectError(f"{folder}: {what}; the kick is too hard, take a smaller wave.amplitude")
    assert folder is not None
    with writable(folder):
        _save(folder / SHEET_RECORD, record)
    return folder / SHEET_RECORD


def _refuse_unfit(scene: Scene) -> None:
    """Raise SceneError if the sheet cannot show its branches from Γ to M and K."""
    time, shape = scene.time, scene.shape
    if shape.lattice != HEXAGONAL:
        raise SceneError(f'packing.lattice = {scene.packing.lattice!r}: must be "hexagonal" for a sheet that is kicked')
    for key, periodic in (("ends", shape.along_y), ("sides", shape.along_x)):
        if not periodic:
            value = getattr(scene.packing, key)
            raise SceneError(f'packing.{key} = {value!r}: must be "periodic" for a sheet that is kicked')
    if not scene.form.waves:
        raise SceneError(
            f'wave.form = "{scene.form.name}": must be another for a sheet that is kicked, which has no sources'
        )
    if scene.sphere.adhesion_law != "dmt":
        raise SceneError(
            f'sphere.adhesion_law = "{scene.sphere.adhesion_law}": must be "dmt" for a sheet that is kicked, as its '
            "record does not name the law"
        )
    for key in scene.departures():
        if key.partition(".")[0] not in _HAS:
            raise SceneError(
                f"{key}: must be left out for a sheet that is kicked, whose record is that of equal spheres in their "
                "places, all of them recorded"
            )
    if shape.columns % 3:  # the rows of a periodic cell are even
        raise SceneError(
            f"packing.columns = {scene.packing.columns!r}: must be a multiple of 3 for a sheet that is kicked, which "
            "otherwise does not hold the corner K of the Brillouin zone"
        )
    time.clock.refuse_ladder(
        "must be left out for a sheet that is kicked, which is run once and estimates no error; give a time.timestep"
    )
    longest = np.pi / highest_frequency(unit_lattice(scene.sphere), scene.sphere)
    if time.sample >= longest:
        raise SceneError(
            f"time.sample = {time.sample!r}: must be below {longest:.4g} tau for a sheet that is kicked, half a period "
            "of its highest frequency"
        )
    if time.samples < FEWEST_SAMPLES:
        raise SceneError(
            f"time.duration = {time.duration!r}: must be at least {FEWEST_SAMPLES} x time.sample = "
            f"{FEWEST_SAMPLES * time.sample!r} tau for a sheet that is kicked, to have a spectrum"
        )


def _save(path: Path, record: Record) -> None:
    """Write ``sheet.npz`` from the snapshots of a run."""
    scene, snapshots = record.scene, record.snapshots()
    spheres = [snapshots[number] for number in range(len(snapshots))]
    constant = lattice_constant(scene.sphere)
    np.savez(
        path,
        tau=snapshots.tau,
        velocity=np.stack([np.column_stack([each.velocity, each.spin]) for each in spheres]),
        position=snapshots.crystal.positions[:, :2] / constant,
        box=snapshots.crystal.cell.lengths()[:2] / constant,
        poisson_ratio=scene.sphere.poisson_ratio,
        overlap_ratio=scene.sphere.overlap_ratio,
        contact_force=scene.sphere.contact_force,
        prestress=scene.sphere.contact_force / scene.sphere.holding_force,
        effects=[name for name, effect in record.info["effects"].items() if effect["on"]],
    )
