"""How cost grows with the lattice: set-up, memory, speed, ranks, kernel, a checkpoint; the error of the centre sphere.

    python -m benchmarks.scale [--spheres N ...] [--ranks N ...] [--repeats N]

The base case's wave on rows × 100 spheres; each run crosses one checkpoint, half-way. The exponent below the table is
that of the seconds a step takes: 1 where cost is linear in the spheres. *Processor* are the seconds of all ranks from
the start of the program to its end, and *CPU use* is what LAMMPS says of its loop: below 100 % the machine did other
work, and the rows of several ranks, which wait for each other, say nothing.
"""

import argparse
import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.problem import base_scene, centre_signals, errors, exact
from benchmarks.timing import interleave, machine, rates, ratio, spread, table
from granular_analysis.measure.norms import slope
from granular_lmp import Scene, build
from granular_lmp.errors import LammpsError, LammpsMissingError
from granular_lmp.lammps.installation import environment, lmp_command
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.outputs import DUMP, LOG, read_centre, read_log
from granular_lmp.runs.options import core_count
from granular_lmp.units import units_for

COLUMNS = 100
GRANULAR = "granular"
WORK = 5e6  # particle-steps a run: a second or two on one core
_GLANCE = 0.02  # s between two looks at a program
HEAD = [
    *(
        "spheres",
        "ranks",
        "contacts",
        "build, s",
        "set-up, s",
        "peak MB a rank",
        "loop, s",
        "÷ 1 rank",
        "M particle-steps/s",
    ),
    *("ns per contact and step", "checkpoint, s", "processor, s", "CPU use, %", "error of p", "of q"),
]


@dataclass(frozen=True)
class Run:
    """One run.

    Seconds to build and write the deck, in LAMMPS before and after the loop, in the loop, and of the checkpoint in it;
    processor seconds; share of the cores that the loop had, %; MB; errors.
    """

    build: float
    setup: float
    loop: float
    checkpoint: float
    processor: float
    use: float
    steps: int
    spheres: int
    peak: float
    error: tuple[float, float]


def sized(spheres: int) -> Scene:
    """Return the base case with about as many spheres, and three samples or as many as make the work `WORK`."""
    rows = round(spheres / COLUMNS) | 1
    samples = max(3, round(WORK / (rows * COLUMNS) / base_scene().time.steps_per_sample))
    return base_scene().with_values(
        {
            "packing.rows": rows,
            "packing.columns": COLUMNS,
            "time.duration": samples * base_scene().time.sample,
            "time.allow_echo": True,
        }
    )


def solve(scene: Scene, ranks: int, kernel: Path | None, folder: Path) -> Run:
    """Build, write and run a scene with ``lmp``, whose contacts may be those of the kernel; the peak is of one rank."""
    started = time.perf_counter()
    deck = build(scene)
    deck.write(folder / "run")
    built = time.perf_counter()
    command = [*lmp_command(ranks), "-in", deck.input_name, "-log", LOG, "-screen", "none"]
    command += ["-var", "checkpoint", str(scene.time.steps // 2 + 1), *(library.SWITCHES if kernel else ())]
    variables = environment(ranks) | library.offered(kernel)
    process = subprocess.Popen(command, cwd=folder / "run", env=variables, stdin=subprocess.DEVNULL)
    peak, processor = _wait(process)
    ended = time.perf_counter()
    if process.returncode:
        raise LammpsError(f"exit status {process.returncode}", " ".join(command), "")
    log = read_log(folder / "run" / LOG)
    loop = log.loop
    dump = read_centre(folder / "run" / DUMP)
    metre = units_for(scene.sphere.radius).number(1.0, length=1)
    p, q = centre_signals(scene, np.column_stack([dump["ux"], dump["uy"]]) / metre)
    return Run(
        build=built - started,
        setup=ended - built - loop,
        loop=loop,
        checkpoint=log.sections["loop.output"],  # and the records of one sphere, which take no time beside it
        processor=processor,
        use=float(
            re.findall(r"^([\d.]+)% CPU use", (folder / "run" / LOG).read_text(encoding="utf-8"), re.MULTILINE)[-1]
        ),
        steps=scene.time.steps,
        spheres=len(deck.packing),
        peak=peak,
        error=errors(scene, p, q),
    )


def _wait(process: "subprocess.Popen[bytes]") -> tuple[float, float]:
    """Wait for a program, and return the most memory of one process and the processor seconds of all.

    The memory, MB, is of the program or of one started by it; 0 where there is no /proc.

    ``lmp`` of the wheel is a script that starts the real one, and the peak that wait4 reports is no less than what this
    Python held when it started the script.
    """
    peak = 0.0
    while True:
        ended, status, usage = os.wait4(process.pid, os.WNOHANG)
        if ended:
            process.returncode = os.waitstatus_to_exitcode(status)
            return peak, usage.ru_utime + usage.ru_stime
        peak = max(peak, *map(_held, _family(process.pid)))
        time.sleep(_GLANCE)


def _family(process: int) -> list[int]:
    """A process and all that descend from it."""
    try:
        children = Path(f"/proc/{process}/task/{process}/children").read_text(encoding="utf-8").split()
    except OSError:
        children = []
    return [process, *(member for child in children for member in _family(int(child)))]


def _held(process: int) -> float:
    """The most memory that a process held so far, MB."""
    try:
        lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM")), 0.0)


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scale", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--spheres", type=int, nargs="+", default=[10_000, 100_000, 1_000_000], metavar="N")
    parser.add_argument("--ranks", type=int, nargs="+", default=_usual_ranks(), metavar="N")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="rounds (default 3)")
    options = parser.parse_args(argv)
    scenes = {spheres: sized(spheres) for spheres in options.spheres}
    for scene in scenes.values():
        exact(scene)
    jobs = {
        (spheres, ranks, kind): partial(solve, scene, ranks, kernel)
        for spheres, scene in scenes.items()
        for kind, kernel in _kinds().items()
        for ranks in options.ranks
    }
    named = {f"{spheres} spheres, {ranks} ranks, {kind}": job for (spheres, ranks, kind), job in jobs.items()}
    rounds = [[run for _, run in done] for done in interleave(named, max(options.repeats, 1)).values()]
    runs = dict(zip(jobs, rounds, strict=True))
    print(machine() + "\n")
    print(table(HEAD, [_line(job, done, runs.get((job[0], 1, job[2]), done)) for job, done in runs.items()]))
    first = [runs[spheres, options.ranks[0], GRANULAR] for spheres in scenes]
    if len(first) > 1:
        per_step = [min(run.loop / run.steps for run in done) for done in first]
        print(f"\nSeconds a step ∝ spheres^{slope([done[0].spheres for done in first], per_step):.3f}")
    return 0


def _usual_ranks() -> list[int]:
    """Return 1, and 2 and 4 where there are as many cores and a program that starts ranks."""
    try:
        lmp_command(2)
    except LammpsMissingError:
        return [1]
    return [ranks for ranks in (1, 2, 4) if ranks <= core_count()]


def _kinds() -> dict[str, Path | None]:
    """Return LAMMPS's contacts and, where it was built, the kernel."""
    try:
        return {GRANULAR: None, "kernel": library.built()}
    except LammpsMissingError:
        return {GRANULAR: None}


def _line(job: tuple[int, int, str], done: list[Run], single: list[Run]) -> list[str]:
    last, loops = done[-1], [run.loop for run in done]
    return [
        str(last.spheres),
        str(job[1]),
        job[2],
        spread([run.build for run in done]),
        spread([run.setup for run in done]),
        f"{last.peak:.0f}",
        spread(loops),
        f"{ratio(loops, [run.loop for run in single]):.2f}",
        *rates(last.spheres * last.steps, loops),
        spread([run.checkpoint for run in done]),
        spread([run.processor for run in done]),
        f"{min(run.use for run in done):.0f}",
        *(f"{error:.1g}" for error in last.error),
    ]


if __name__ == "__main__":
    sys.exit(main())
