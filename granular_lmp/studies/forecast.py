"""Forecast of a run without running it: its size, seconds on this machine, and memory.

The seconds are extrapolated from a short run of the same deck. For a large crystal the short run is a cell with the
same spheres and effects, because even a few steps of the crystal would take long.
"""

from math import ceil, inf, isnan, isqrt, nan, pi
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from granular_lmp.accuracy.ladder import build, plan, planned
from granular_lmp.accuracy.tolerance import run
from granular_lmp.crystal.lattice import Lattice
from granular_lmp.errors import GranularError, LaunchError
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.checkpoints import minutes_between
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.laws import contacts
from granular_lmp.lammps.region_of_influence import mean_count
from granular_lmp.problem import Problem
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.sections import Wave

_WARM_UP = 2e5  # sphere-steps of the short run: 50 ms
_FEWEST_STEPS = 100  # steps of a short run with a shortened sample: its two records take 8 % at most
_LARGEST = (
    20_000  # largest number of spheres of a crystal that is measured directly: two runs of it start in half a second
)
_PERIOD = 12  # a multiple of the periods of rows and columns in every lattice
_CELL = 100  # rows and columns of the cell that stands for a larger crystal
# Tables and keys of a scene that the cell keeps, because they determine the time of a step
_OF_CELL = ("sphere", "contact", "substrate", "disorder", "time", "effects")
_PARTS = {
    "packing": ("lattice", "orientation", "layers", "depth", "space", "contact_force"),
    "wave": ("mode", "amplitude"),
}
# Measured maximum of a process: 71 MB for 48 spheres, 170 MB for 90 000, 279 MB for 180 000
_PROCESS = 71e6
_SPHERE = 1160.0
_NOT_PERFECT = (
    1000.0  # more for unequal spheres, as all contacts are stored: 276 MB for 99 900 spheres of unequal densities
)
# Without a wave also the record, while it is read: 103 MB for 2.5e5 places of a sphere, 196 MB for 1.0e6; and 40
# bytes of each in the records of the other runs to a tolerance: 127 MB for 2.5e5 places in three runs
_READ, _KEPT = 130.0, 40.0
# Largest share of the loop that more ranks do not shorten: 2 ranks took 0.52 to 0.55 of the time, 4 ranks 0.30
SERIAL = 0.1
# s by which a run on several ranks, with mpiexec and the program lmp, starts later than one in a warm process: at least
# 0.70 in six runs of 20 steps each
START_OF_RANKS = 0.7


@dataclass(frozen=True)
class Forecast:
    """Size, time and memory of a run of a scene.

    Attributes
    ----------
    spheres, steps, records, runs : int
        Steps of all runs together; a scene with a tolerance has several runs.
    snapshots : int
        Number of snapshots of all spheres.
    start : float or None
        Seconds outside the time loop, which more ranks do not shorten; None if LAMMPS is not available.
    seconds : float or None
        Seconds of a run on one rank, including `start`; None if LAMMPS is not available.
    basis : str
        Basis of the seconds, or the reason why there are none.
    memory : float
        Bytes.
    checkpoint : float
        Minutes between two checkpoints.
    slower : float or None
        Seconds on one rank without the kernel, if a run uses the kernel by default but does not need it.
    share : str
        Words for the time of the kernel over that of the LAMMPS loop in the short run.
    without_kernel : str
        Why a run uses no kernel: it was not built, or it does not support a contact of the deck; "" if the seconds
        include it.
    needs_kernel : str
        What only the kernel supports; "" if LAMMPS can run the deck.
    """

    spheres: int
    steps: int
    records: int
    runs: int
    snapshots: int
    start: float | None
    seconds: float | None
    basis: str
    memory: float
    checkpoint: float
    slower: float | None = None
    share: str = ""
    without_kernel: str = ""
    needs_kernel: str = ""

    def lost_on(self, ranks: int) -> str:
        """Return why some MPI ranks are slower than one; "" if they may be faster or nothing is known."""
        if self.start is None or self.seconds is None:
            return ""
        later, saved = START_OF_RANKS * self.runs, (self.seconds - self.start) * (1 - 1 / ranks)
        slower = f"{ranks} are slower: they start {later:.2g} s later and save at most {saved:.2g} s"
        return slower if saved < later else ""

    def on(self, ranks: int) -> tuple[float, float] | None:
        """Return the smallest and largest seconds on some MPI ranks; None if the seconds on one are unknown.

            start + loop/R  to  start + loop (1/R + s (1 − 1/R)),    s = `SERIAL`

        On 2 and 4 ranks of one machine, sheets of 1e4 to 1e6 spheres lie between the two; more ranks are extrapolated.
        With less than a thousand spheres per rank the gain is smaller.
        """
        if self.start is None or self.seconds is None:
            return None
        loop = self.seconds - self.start
        return self.start + loop / ranks, self.start + loop * (1 / ranks + SERIAL * (1 - 1 / ranks))


def forecast(problem: Problem) -> Forecast:
    """Return the forecast for a run of a problem, from a short run in a temporary folder.

    The seconds are only good to a factor of two. They fail if steps become slower during the run, as when contacts open
    or close (nine impacts took 1 to 1.8 times as long), or if the load of the machine changes. A run to a tolerance
    takes more steps if its errors require it.
    """
    finest, counts = planned(problem), plan(problem)
    scene = finest.scene
    spheres, runs, steps = len(problem.rest.atoms), len(counts), sum(counts) * scene.time.samples
    records = scene.time.samples + 1
    kept = len(problem.rest.recorded) * records if problem.wave is None else 0  # snapshots of a wave are not read
    (lack, alone), plain = _kernel(problem), None
    try:
        if alone and lack:
            raise LaunchError(lack)
        rate, overhead, basis = _tried(finest, kernel=not lack)
        plain = None if lack or alone else _tried(finest, kernel=False)[0]
    except GranularError as error:
        rate, overhead, basis = inf, nan, f"unknown: {error}"
    start = runs * overhead
    of_sphere = _SPHERE if scene.perfect else _SPHERE + _NOT_PERFECT
    seconds = start + mean_count(problem) * steps / rate
    return Forecast(
        spheres=spheres,
        steps=steps,
        records=records,
        runs=runs,
        snapshots=_snapshots(finest),
        start=None if isnan(start) else start,
        seconds=None if isnan(seconds) else seconds,
        basis=basis,
        memory=_PROCESS + of_sphere * spheres + (_READ + _KEPT * (runs - 1)) * kept,
        checkpoint=minutes_between(scene.output.checkpoint, spheres),
        slower=start + mean_count(problem) * steps / plain if plain else None,
        share=f"{plain / rate:.2f} of the time of the LAMMPS loop in a short run just now" if plain else "",
        without_kernel=lack,
        needs_kernel=alone,
    )


def _kernel(problem: Problem) -> tuple[str, str]:
    """Return why a run uses no kernel, and what needs the kernel; each is "" if there is nothing."""
    text = "\n".join(contacts(problem))
    lack, alone = library.unknown_in(text), library.only_here(text)
    try:
        library.built()
    except GranularError as error:
        lack = lack or error.in_options()
    return lack, alone


def _snapshots(problem: Problem) -> int:
    """Return the number of snapshots of all spheres."""
    scene = problem.scene
    if problem.wave is None:
        return scene.time.samples + 1 if scene.output.everyone else 0
    every = scene.output.particles
    return int(scene.time.duration / every + 1e-9) + 1 if every else 0


def _tried(problem: Problem, kernel: bool = False) -> tuple[float, float, str]:
    """Return sphere-steps per second, seconds outside the loop, and the basis of both."""
    small, spheres = _small(problem), problem.scene.shape.spheres
    rate, overhead = speed(small, kernel)
    cell = "this scene" if small.shape.spheres == spheres else f"a cell of {small.shape.words}"
    start = overhead * max(1.0, spheres / small.shape.spheres)
    return rate, start, f"a short run of {cell} just now, {rate:.2g} sphere-steps per second"


def _small(problem: Problem) -> Scene:
    """Return the scene of a problem, or a cell that stands for it, shortened to the steps of a short run.

    The cell has the spheres, contacts and time of the scene, with a wave along y that fits it, or a striker in its
    middle. All other values are defaults: a step then takes as long per sphere, and no place or end has to fit a
    smaller crystal.
    """
    scene = problem.scene
    rows, columns = _size(scene.lattice, scene.shape.layers)
    if scene.shape.spheres > max(_LARGEST, rows * columns * scene.shape.layers):
        tables = scene.to_dict()
        kept = {
            table: {key: value for key, value in tables[table].items() if value is not None}
            for table in _OF_CELL
            if table in tables
        }
        own = _struck_cell(problem, rows, columns) if scene.wave is None else _waving_cell(scene.wave, tables, rows)
        own["packing"] |= {"rows": rows, "columns": columns}
        scene = Scene.from_dict(kept | own)
    steps = max(_FEWEST_STEPS, ceil(_WARM_UP / scene.shape.spheres))
    if steps >= scene.time.steps_per_sample:
        return scene
    sample = steps * scene.time.step
    return scene.with_values({"time.sample": sample, "time.duration": sample})


def _size(lattice: Lattice, layers: int) -> tuple[int, int]:
    """Return rows and columns of a cell of about 1e4 spheres; with several layers they fit any lattice."""
    places = _CELL**2 // layers
    columns = 1 if not lattice.sheet else _CELL if layers == 1 else max(_PERIOD, isqrt(places) // _PERIOD * _PERIOD)
    rows = places // columns
    return (rows if layers == 1 else max(_PERIOD, rows // _PERIOD * _PERIOD)), columns


def _waving_cell(wave: Wave, tables: dict[str, Any], rows: int) -> dict[str, dict[str, Any]]:
    kept = {table: {key: tables[table][key] for key in keys if key in tables[table]} for table, keys in _PARTS.items()}
    kept["packing"] |= {"ends": "periodic"}
    kept["wave"] |= {"wavenumber": min(max(wave.wavenumber, 2 * pi / rows), pi)}
    return kept | {"time": tables["time"] | {"allow_echo": True}}


def _struck_cell(problem: Problem, rows: int, columns: int) -> dict[str, Any]:
    return {
        "packing": problem.scene.to_dict()["packing"] | {"table": ""},  # the cell does not have their places
        "striker": [{"spheres": [[rows // 2, columns // 2]], "velocity": problem.rest.scale.velocity}],
        "output": {} if _snapshots(problem) else {"rows": [0, 0]},
    }


def speed(scene: Scene, kernel: bool = False) -> tuple[float, float]:
    """Return sphere-steps per second, and the seconds outside the time loop, of a short run with a step."""
    per_sample = scene.shape.spheres * scene.time.steps_per_sample
    duration = scene.time.sample * min(ceil(_WARM_UP / per_sample), scene.time.samples)
    none = {"output.particles": 0.0} if scene.output.particles > duration else {}
    short = scene.with_values({"time.duration": duration, "packing.rows": scene.shape.rows} | none)
    deck = build(short)
    with TemporaryDirectory(prefix="granular-lmp-") as folder:
        for name in ("cold", "warm"):  # the first run starts LAMMPS
            info = run(deck, Path(folder) / name, kernel=kernel).info
    seconds = info["wall_seconds"]
    return mean_count(deck.problem) * info["steps"] / seconds["loop"], seconds["total"] - seconds["loop"]
