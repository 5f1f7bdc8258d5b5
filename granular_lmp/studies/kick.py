"""A periodic sheet kicked at random: one run that holds every wave of the lattice, and the record of all its spheres.

The deck is that of the scene; in place of the wave its data file holds random velocities, small enough to stay linear.
A second input includes the deck with a duration of 0, which makes the sheet and kicks it, then records and runs: the
deck itself is not touched. ``analysis.dispersion`` reads what comes out.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import lattice_constant
from granular_lmp.errors import EffectError, RunFolderError, SceneError
from granular_lmp.lammps.deck import Deck, build, writable
from granular_lmp.lammps.outputs import LOG, SCENE, read_log
from granular_lmp.lammps.units import units_for
from granular_lmp.runs.launch import locked, run_input
from granular_lmp.scene.scene import Scene

INPUT = "in.sheet"
DUMP = "dump.sheet"
SHEET = "sheet.npz"

# Guards of the deck, at what value they say that the sheet is not linear, and why
_LINEAR = (("v_slip", 1.0, "contacts slid"), ("v_open", 1.0, "contacts opened"))

_INPUT = """\
# The sheet of {deck}, all spheres recorded. Runs in this folder:  lmp -in {name}
variable duration index 0  # the deck makes the sheet, kicks it, and stops there
include  {deck}
dump     sheet all custom ${{every}} {dump} id vx vy omegaz
dump_modify sheet sort id format float %.9g
run      {steps}
"""


def kicked(deck: Deck, seed: int = 0) -> Deck:
    """The deck with random velocities in place of its wave: ẋ, ẏ and Rθ̇ uniform in ±½ D0/t0, no displacement.

    Every mode gets the same energy in the mean; the mean velocity, which would carry the sheet away, is taken out.

    Raises
    ------
    EffectError
        When the spheres of the deck do not turn.
    """
    if deck.data.wave.shape[1] != 6:
        raise EffectError(
            "effects.rotation is off: a kicked sheet needs spheres that turn, for instance wave.mode = TR"
        )
    velocity = np.random.default_rng(seed).uniform(-0.5, 0.5, (len(deck.data.wave), 3))
    velocity[:, :2] -= velocity[:, :2].mean(axis=0)
    return replace(deck, data=replace(deck.data, wave=np.hstack([np.zeros_like(velocity), velocity])))


def run_kicked(scene: Scene, folder: str | Path, seed: int = 0, *, force: bool = False) -> Path:
    """Kick the sheet of a scene, run it, and return the path of ``sheet.npz``.

    Parameters
    ----------
    scene : Scene
        Periodic along y; its wave says how hard (D0), its time how long, and how often all spheres are recorded.
    folder : path
        Made here.
    seed : int
        Of the kick.
    force : bool
        Run again in a folder that is there.

    Returns
    -------
    Path
        ``tau`` (T,); ``velocity`` (T, N, 3): ẋ, ẏ, Rθ̇ in D0/t0; ``position`` (N, 2) at rest and ``box`` (2,), in
        lattice constants; ``poisson_ratio`` and ``overlap_ratio``.

    Raises
    ------
    SceneError
        For a strip between fixed ends.
    RunFolderError
        When the folder is there (without `force`).
    EffectError
        When spheres do not turn, or contacts slid or opened: the kick was too hard.
    LammpsMissingError, LammpsError
    """
    if scene.shape.ends != "periodic":
        raise SceneError(f'packing.ends = {scene.packing.ends!r}: must be "periodic" for a sheet that is kicked')
    folder = Path(folder).absolute()
    deck = kicked(build(scene), seed)
    scene = deck.scene
    with locked(folder, make=True, force=force) as lock:
        deck.write(folder, force=True)
        with writable(folder):
            (folder / SCENE).write_text(scene.to_toml(), encoding="utf-8")
            text = _INPUT.format(deck=deck.input_name, name=INPUT, dump=DUMP, steps=scene.time.steps)
            (folder / INPUT).write_text(text, encoding="utf-8")
        run_input(folder, INPUT, lock)
    log = read_log(folder / LOG)[0]
    for column, limit, what in _LINEAR:
        if log.get(column, np.zeros(1)).max() >= limit:
            raise EffectError(f"{folder}: {what}; the kick is too hard, take a smaller wave.amplitude")
    steps, velocity = read_sheet(folder / DUMP)
    sphere, units = scene.sphere, units_for(scene.sphere.radius)
    velocity[:, :, 2] *= units.number(sphere.radius, length=1)
    unit = scene.wave.amplitude * units.number(sphere.static_overlap / sphere.time_scale, length=1, time=-1)
    constant = lattice_constant(sphere)
    np.savez(
        folder / SHEET,
        tau=steps * scene.time.step,
        velocity=velocity / unit,
        position=deck.packing.positions[:, :2] / constant,
        box=deck.packing.cell.lengths()[:2] / constant,
        poisson_ratio=sphere.poisson_ratio,
        overlap_ratio=sphere.overlap_ratio,
    )
    return folder / SHEET


def read_sheet(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Steps (T,) and columns vx, vy, omegaz (T, N, 3) of a dump of all spheres, sorted.

    Raises
    ------
    RunFolderError
        When the file is not such a dump.
    """
    steps, frames = [], []
    try:
        with path.open(encoding="utf-8") as stream:
            while stream.readline():
                steps.append(int(stream.readline()))
                stream.readline()
                count = int(stream.readline())
                for _ in range(5):  # of the box, and the names of the columns
                    stream.readline()
                lines = "".join(stream.readline() for _ in range(count))
                frames.append(np.fromstring(lines, sep=" ").reshape(count, 4)[:, 1:])
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{path}: not a dump of a sheet: {error}") from error
    return np.array(steps, dtype=float), np.array(frames)
