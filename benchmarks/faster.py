"""Ways to make the base case cheaper, each against the straightforward strip: loop time, ratio, error of p and q.

    python -m benchmarks.faster [--repeats N] [--only NAME ...]

A variant is a scene with other values, or a stated edit of the deck's text, or two runs extrapolated. All errors are
against the exact lattice at ξ = 0.802, whatever wave number the variant's cell allows. What came out, and which
variants are robust, is in RESULTS.md.
"""

import argparse
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.problem import Floats, base_scene, centre_signals, errors, exact
from benchmarks.timing import both_ratios, interleave, machine, rates, spread, table
from granular_lmp import Scene, build
from granular_lmp.lammps.datafile import DataFile, read
from granular_lmp.lammps.installation import lmp_command
from granular_lmp.lammps.outputs import DUMP, LOG, read_centre, read_log
from granular_lmp.rest.shape import quiet_rows
from granular_lmp.units import units_for

Edit = Callable[[str], str]
NEVER = 1_000_000_000  # steps
HEAD = [
    *("variant", "what", "spheres", "steps", "loop, s", "ratio", "error of p", "of q"),
    *("M particle-steps/s", "ns per contact and step"),
]


@dataclass(frozen=True)
class Variant:
    """One way: scene values, edits of ``in.NAME``, a change of the data file, MPI ranks, extrapolation."""

    what: str
    values: dict[str, Any] = field(default_factory=dict)
    edits: tuple[Edit, ...] = ()
    data: Callable[[DataFile, Scene], DataFile] | None = None
    tilted: bool = False
    ranks: int = 1
    richardson: bool = False


@dataclass(frozen=True)
class Outcome:
    """p and q at the base case's times, seconds in the loop, spheres, steps, particle-steps."""

    p: Floats
    q: Floats
    loop: float
    spheres: int
    steps: int
    work: float


# --- edits of the deck's text ----------------------------------------------------------------------------------------


def swap(old: str, new: str) -> Edit:
    """Replace a piece of text that must be there exactly once."""

    def edit(text: str) -> str:
        if text.count(old) != 1:
            raise ValueError(f"the deck holds {text.count(old)} times {old!r}, not once")
        return text.replace(old, new)

    return edit


def with_command(old: str, added: str) -> Edit:
    """Put a command behind the line that starts with `old`, which must be there exactly once."""

    def edit(text: str) -> str:
        lines = text.split("\n")
        (place,) = [number for number, line in enumerate(lines) if line.startswith(old)]
        return "\n".join([*lines[: place + 1], added, *lines[place + 1 :]])

    return edit


def without(start: str) -> Edit:
    """Drop the line that starts so, which must be there exactly once."""

    def edit(text: str) -> str:
        lines = text.split("\n")
        (place,) = [number for number, line in enumerate(lines) if line.startswith(start)]
        return "\n".join(lines[:place] + lines[place + 1 :])

    return edit


def pressed(text: str) -> str:
    """Hertz spheres without adhesion that the cell holds at the same overlap, through ``gran/hertz/history``.

    Its coefficients are (4/3)E* and 8G*, its sliding force has no adhesion in it: twice the friction.
    """
    sphere = base_scene().sphere
    pascal = units_for(sphere.radius).number(1.0, mass=1, length=-1, time=-2)
    normal, shear = 4 / 3 * sphere.effective_modulus * pascal, 8 * sphere.effective_shear_modulus * pascal
    friction = 10 * base_scene().amplitude
    start = text.index("pair_style   granular")
    end = text.index("\n\n", start)
    style = f"pair_style   gran/hertz/history {normal!r} {shear!r} 0.0 0.0 {friction!r} 0\npair_coeff   * *"
    return text[:start] + style + text[end:]


QUIET = "thermo_style custom step\n\n"


def unguarded(text: str) -> str:
    """Leave the guards out, and with them all looks at contacts and the verdict, the last lines."""
    return re.sub(r"# --- guards.*?\n\n", QUIET, text.partition("echo ")[0], count=1, flags=re.DOTALL)


def listed_once(text: str) -> str:
    """Preload and run on one and the same neighbour list: a single column's history survives no other.

    Everything that a run sets up is defined before the first; records then fall one step late. Guards are left out.
    """
    head, rest = text.split("# --- preload", 1)
    preload, rest = rest.split("# --- wave:", 1)
    wave, rest = rest.split("# --- motion", 1)
    preload = swap("nve/noforce", "nve/sphere update dipole")(swap("1e6*v_step", "v_step")(preload))
    preload = preload[: preload.index("thermo_style custom step\nrun")]
    _, record = rest.partition("echo ")[0].split("# --- record", 1)
    record = swap("run ${steps}", "")(swap("custom ${every}", "custom 1")(record))
    return (
        head
        + f"neigh_modify delay {NEVER} every {NEVER} check no\n# --- preload"
        + preload
        + QUIET
        + "# --- record"
        + record
        + "variable when equal stride(1,1000000000,v_every)\ndump_modify centre every v_when\n"
        + "run 1 post no\n# --- wave:"
        + wave
        + "run ${steps} pre no post no\n"
    )


def single_column(data: DataFile, scene: Scene) -> DataFile:
    """The column of the centre sphere alone, in a cell one lattice constant wide."""
    columns = scene.shape.columns
    width = (data.box[0, 1] - data.box[0, 0]) / columns
    kept = np.flatnonzero(np.arange(len(data.kind)) % columns == columns // 2)
    return _chosen(data, kept, np.array([[0.0, width], *data.box[1:]]))


def one_period_less(data: DataFile, scene: Scene) -> DataFile:
    """The lower half of a periodic cell of 2N rows, N odd: row N is row 0 half a lattice constant to the right.

    The centre row moves from N − 1 to N//2, and the wave with it.
    """
    columns, rows = scene.shape.columns, scene.shape.rows // 2
    spacing = (data.box[1, 1] - data.box[1, 0]) / scene.shape.rows
    first = scene.shape.centre_row - rows // 2
    kept = np.arange(first * columns, (first + rows) * columns)
    low = data.box[1, 0] + first * spacing
    return _chosen(data, kept, np.array([data.box[0], [low, low + rows * spacing], data.box[2]]))


def _chosen(data: DataFile, kept: Any, box: Floats) -> DataFile:
    names = ("kind", "position", "diameter", "density", "wave")
    return replace(data, box=box, **{name: getattr(data, name)[kept] for name in names})


# --- the variants ----------------------------------------------------------------------------------------------------


def variants() -> dict[str, Variant]:
    """Name → variant; the first is what the others are measured by."""
    auto = quiet_rows(base_scene().time.duration)
    few = {"packing.rows": auto}
    coarse = {"time.timestep": 0.1}
    ring = {"packing.rows": 94, "packing.ends": "periodic"}  # 2π·12/94 = 0.80211
    column: dict[str, Any] = {"edits": (listed_once,), "data": single_column}
    echo = {"time.allow_echo": True}
    return {
        "base": Variant("201 × 3, held ends, step 0.05"),
        "no-guards": Variant("no look at contacts, thermo output at the end only", edits=(unguarded,)),
        "no-record": Variant("one record instead of 240", {"time.sample": 120.0}),
        "skin-small": Variant("skin 2 nm instead of 50", edits=(swap("neighbor     50.0", "neighbor     2.0"),)),
        "list-frozen": Variant(
            "neighbour list never checked",
            edits=(with_command("run          1 post no", f"neigh_modify delay {NEVER} every {NEVER} check no"),),
        ),
        "no-enforce2d": Variant("without fix enforce2d", edits=(without("fix          plane"),)),
        "no-sort": Variant("atoms not sorted", edits=(swap("map array", "map array sort 0 0.0"),)),
        "newton-off": Variant("newton off (LAMMPS's default is on)", edits=(with_command("units ", "newton off"),)),
        "pressed": Variant("gran/hertz/history, no adhesion, pressed to Δ0", edits=(pressed,)),
        "six-columns": Variant("201 × 6: the work of two strips in one instance", {"packing.columns": 6}),
        "rows-auto": Variant(f"{auto} rows: the echo rule for τ = 120", few),
        "rows-131": Variant("131 rows: fewer than the echo rule", {"packing.rows": 131} | echo),
        "rows-121": Variant("121 rows", {"packing.rows": 121} | echo),
        "periodic": Variant("periodic, 94 rows, ξ = 2π·12/94", ring),
        "periodic-odd": Variant("periodic, 47 rows in a tilted cell", ring, data=one_period_less, tilted=True),
        "column": Variant("1 column, one neighbour list, no guards", **column),
        "two-ranks": Variant("2 MPI ranks", ranks=2),
        "step-0.1": Variant("step 0.1", coarse),
        "step-0.125": Variant("step 0.125", {"time.timestep": 0.125}),
        "auto-0.1": Variant(f"{auto} rows, step 0.1", few | coarse),
        "auto-0.1-2": Variant(f"{auto} rows, step 0.1, 2 ranks", few | coarse, ranks=2),
        "periodic-0.1": Variant("periodic, 94 rows, step 0.1", ring | coarse),
        "rich-0.083": Variant(
            f"{auto} rows, steps 1/6 and 1/12 extrapolated", few | {"time.timestep": 0.2}, richardson=True
        ),
        "rich-0.125": Variant(
            f"{auto} rows, steps 0.25 and 0.125 extrapolated", few | {"time.timestep": 0.25}, richardson=True
        ),
        "rich-0.25": Variant(
            f"{auto} rows, steps 0.5 and 0.25 extrapolated", few | {"time.timestep": 0.5}, richardson=True
        ),
        "column-0.1": Variant(f"1 column, {auto} rows, step 0.1", few | coarse, **column),
        "column-rich": Variant(
            f"1 column, {auto} rows, steps 0.25 and 0.125 extrapolated",
            few | {"time.timestep": 0.25},
            richardson=True,
            **column,
        ),
    }


# --- running ---------------------------------------------------------------------------------------------------------


def solve(variant: Variant, folder: Path) -> Outcome:
    """Run a variant in an empty folder."""
    scene = base_scene().with_values(variant.values)
    coarse = _run(variant, scene, folder / "coarse")
    if not variant.richardson:
        return coarse
    fine = _run(variant, scene.with_values({"time.timestep": scene.time.step / 2}), folder / "fine")
    return Outcome(
        p=(4 * fine.p - coarse.p) / 3,
        q=(4 * fine.q - coarse.q) / 3,
        loop=coarse.loop + fine.loop,
        spheres=fine.spheres,
        steps=coarse.steps + fine.steps,
        work=coarse.work + fine.work,
    )


def _run(variant: Variant, scene: Scene, folder: Path) -> Outcome:
    deck = build(scene)
    deck.write(folder)
    script, data_path = folder / deck.input_name, folder / deck.data_name
    text, data = script.read_text(encoding="utf-8"), read(data_path)
    for edit in variant.edits:
        text = edit(text)
    if variant.data:
        centre = data.position[int(np.argmin(np.abs(data.position[:, :2]).sum(axis=1)))]
        data = variant.data(data, scene)
        index = int(np.flatnonzero((data.position == centre).all(axis=1))[0])
        text = _renamed_centre(text, index + 1)
        data_text = data.text("edited")
        if variant.tilted:
            tilt = float(data.box[0, 1] - data.box[0, 0]) / scene.shape.columns / 2
            data_text = data_text.replace(" zlo zhi\n", f" zlo zhi\n{tilt!r} 0 0 xy xz yz\n", 1)
        data_path.write_text(data_text, encoding="utf-8")
    script.write_text(text, encoding="utf-8")
    command = [*lmp_command(variant.ranks), "-in", script.name, "-log", LOG, "-screen", "none"]
    subprocess.run(command, cwd=folder, check=True, stdin=subprocess.DEVNULL)
    loop = read_log(folder / LOG).loop
    dump = read_centre(folder / DUMP)
    metre = units_for(scene.sphere.radius).number(1.0, length=1)
    p, q = centre_signals(scene, np.column_stack([dump["ux"], dump["uy"]]) / metre)
    spheres, steps = len(data.kind), scene.time.steps
    return Outcome(p, q, loop, spheres, steps, float(spheres) * steps)


def _renamed_centre(text: str, identity: int) -> str:
    lines = text.split("\n")
    (place,) = [number for number, line in enumerate(lines) if line.startswith("group        centre id ")]
    lines[place] = f"group        centre id {identity}"
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    every = variants()
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faster", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="rounds (default 5)")
    parser.add_argument("--only", nargs="+", choices=every, metavar="NAME", help=", ".join(every))
    options = parser.parse_args(argv)
    chosen = {"base": every["base"]} | {name: every[name] for name in options.only or every}
    exact(base_scene())
    jobs = {name: (lambda folder, variant=variant: solve(variant, folder)) for name, variant in chosen.items()}
    rounds = interleave(jobs, max(options.repeats, 1))
    outcomes = {name: [outcome for _, outcome in done] for name, done in rounds.items()}
    print(machine() + "\n")
    print(table(HEAD, [_line(name, chosen[name], done, outcomes["base"]) for name, done in outcomes.items()]))
    return 0


def _line(name: str, variant: Variant, outcomes: list[Outcome], base: list[Outcome]) -> list[str]:
    last, loops = outcomes[-1], [outcome.loop for outcome in outcomes]
    reference = (
        base_scene().with_values({"time.sample": base_scene().time.duration}) if len(last.p) == 2 else base_scene()
    )
    return [
        name,
        variant.what,
        str(last.spheres),
        str(last.steps),
        spread(loops),
        both_ratios(loops, [outcome.loop for outcome in base]),
        *(f"{error:.2g}" for error in errors(reference, last.p, last.q)),
        *rates(last.work, loops),
    ]


if __name__ == "__main__":
    sys.exit(main())
