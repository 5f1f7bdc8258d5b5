"""A periodic sheet kicked at random: one run that excites every wave of the lattice, with a record of all spheres.

The deck is that of the scene; in place of the wave its data file holds random velocities, small enough to stay linear.
A second input includes the deck with a duration of 0, which makes the sheet and kicks it, then records and runs: the
deck itself is not touched. ``granular-analysis dispersion`` reads what comes out.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.ladder import build
from granular_lmp.crystal.lattices import HEXAGONAL, lattice_constant, unit_lattice
from granular_lmp.crystal.modes import highest_frequency
from granular_lmp.errors import EffectError, LammpsError, SceneError
from granular_lmp.lammps.deck import Deck, deck_of
from granular_lmp.lammps.outputs import LOG, SCENE, read_dump, read_log, writable
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.launch import run_files
from granular_lmp.scene.scene import Scene
from granular_lmp.units import units_for

INPUT = "in.sheet"
SHEET_DUMP = "dump.sheet"
SHEET_COLUMNS = ("id", "vx", "vy", "omegaz")
SHEET_RECORD = "sheet.npz"
FEWEST_SAMPLES = 8  # records after tau = 0; with fewer the window of a spectrum leaves hardly any data

# What a scene may say that is kicked: of anything else, the record does not tell its reader
_HAS = frozenset({"name", "sphere", "packing", "wave", "time", "effects", "output"})
# Guards of the deck, the values from which on the sheet is not linear, and the reasons
_LINEAR = (("v_slip", 1.0, "contacts slid"), ("v_open", 1.0, "contacts opened"))

_INPUT_TEXT = """\
# The sheet of {deck}, all spheres recorded. Runs in this folder:  lmp -in {name}
variable duration index 0  # the deck makes the sheet, kicks it, and stops there
include  {deck}
group    inside static  # all spheres are recorded, so that guards judge all
group    inside union all
dump     sheet all custom ${{every}} {dump}
dump_modify sheet sort id format float %.9g
run      {steps}
"""


def kicked(deck: Deck, seed: int = 0) -> Deck:
    """Return the deck with random velocities instead of its wave: ẋ, ẏ and Rθ̇ uniform in ±½ D0/t0, no displacement.

    Every mode gets the same mean energy. The mean velocity is subtracted, because it would carry the sheet away.

    Raises
    ------
    SceneError
        If the spheres of the deck do not turn.
    """
    if not deck.problem.physics.rotation:
        raise SceneError(
            "effects.rotation is off: must be on for a sheet that is kicked, for instance with wave.mode = TR"
        )
    if len(deck.data.wave) < len(deck.packing):  # LAMMPS would make the spheres and their wave
        deck = deck_of(deck.problem, all_spheres=True)
    velocity = np.random.default_rng(seed).uniform(-0.5, 0.5, (len(deck.data.wave), 3))
    velocity[:, :2] -= velocity[:, :2].mean(axis=0)
    return replace(deck, data=replace(deck.data, wave=np.hstack([np.zeros_like(velocity), velocity])))


def run_kicked(scene: Scene, folder: str | Path, seed: int = 0, *, force: bool = False) -> Path:
    """Kick the sheet of a scene, run it, and return the path of ``sheet.npz``.

    Parameters
    ----------
    scene : Scene
        Periodic sheet. The amplitude D0 of its wave sets the velocities, its times the duration and the interval of the
        records of all spheres.
    folder : path
        Run folder, which is created.
    seed : int
        Seed of the random velocities.
    force : bool
        Run again in an existing folder.

    Returns
    -------
    Path
        Path of ``sheet.npz`` with ``tau`` (T,); ``velocity`` (T, N, 3): ẋ, ẏ, Rθ̇ in D0/t0; ``position`` (N, 2) at rest
        and ``box`` (2,), in lattice constants; ``poisson_ratio``, ``overlap_ratio`` and ``contact_force``; ``effects``,
        the names of the effects that are on.

    Raises
    ------
    SceneError
        If the lattice is not hexagonal, the scene has fixed ends, monitors or a tolerance, its columns are not a
        multiple of 3, spheres do not turn, or its records are too few or too far apart.
    RunFolderError
        If the folder exists (without `force`).
    EffectError
        If contacts slid or opened because the velocities were too large.
    LammpsMissingError, LammpsError
        As in `granular_lmp.run`.
    """
    folder = absolute(folder)
    _refuse_unfit(scene)
    deck = kicked(build(scene), seed)
    scene = deck.scene
    dump = " ".join([SHEET_DUMP, *SHEET_COLUMNS])
    text = _INPUT_TEXT.format(deck=deck.input_name, name=INPUT, dump=dump, steps=scene.time.steps)
    run_files(folder, deck.files() | {SCENE: [scene.to_toml()], INPUT: [text]}, INPUT, force=force)
    log = read_log(folder / LOG).table
    for column, limit, what in _LINEAR:
        if log.get(column, np.zeros(1)).max() >= limit:
            raise EffectError(f"{folder}: {what}; the kick is too hard, take a smaller wave.amplitude")
    table = read_dump(folder / SHEET_DUMP, len(deck.packing), SHEET_COLUMNS)
    velocity = np.stack([table[name] for name in SHEET_COLUMNS[1:]], axis=-1)
    if len(velocity) != scene.time.samples + 1 or not np.isfinite(velocity).all():
        raise LammpsError(f"{SHEET_DUMP} is cut off or holds numbers that are not finite", INPUT, "")
    with writable(folder):
        _save(folder / SHEET_RECORD, deck, table["step"], velocity)
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
    if scene.wave.form == "none":
        raise SceneError('wave.form = "none": must be another for a sheet that is kicked, which has no sources')
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
    if time.tolerance is not None:
        raise SceneError(
            f"time.tolerance = {time.tolerance!r}: must be left out for a sheet that is kicked, which is run once and "
            "estimates no error; give a time.timestep"
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


def _save(path: Path, deck: Deck, steps: NDArray[np.float64], velocity: NDArray[np.float64]) -> None:
    """Write ``sheet.npz`` from LAMMPS's dump, which is in the units of the deck."""
    scene, sphere = deck.scene, deck.scene.sphere
    units, constant = units_for(sphere.radius), lattice_constant(sphere)
    radius = units.number(sphere.radius, length=1)
    unit = units.number(scene.displacement_amplitude / sphere.time_scale, length=1, time=-1)
    np.savez(
        path,
        tau=steps * scene.time.step,
        velocity=velocity * [1.0, 1.0, radius] / unit,
        position=deck.packing.positions[:, :2] / constant,
        box=deck.packing.cell.lengths()[:2] / constant,
        poisson_ratio=sphere.poisson_ratio,
        overlap_ratio=sphere.overlap_ratio,
        contact_force=sphere.contact_force,
        effects=[effect.name for effect in deck.problem.effects if effect.on],
    )
