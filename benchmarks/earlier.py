"""The base case to p ≤ 1 % beside an earlier commit of this repository, as whole processes in turn.

    python -m benchmarks.earlier [COMMIT] [--repeats N]

The commit, by default the first version, is taken out of git into a temporary folder and run by the same Python and
LAMMPS, with a kernel if ``granular-lmp build-kernel`` made one. Processor time is user and system of the process.
"""

import argparse
import io
import os
import resource
import subprocess
import sys
import tarfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.ours import missing_kernel
from benchmarks.timing import both_ratios, interleave, machine, spread, table

FIRST = "e02a04e"
ROOT = Path(__file__).parents[1]
RUN = ("run", "tr_nonresonant", "--set", "time.tolerance=0.01", "--set", "packing.rows=auto")
HEAD = ["", "processor, s", "ratio", "wall, s", "ratio"]


def taken_out(commit: str, folder: Path) -> Path:
    """Return the folder with the files of a commit."""
    files = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=io.BytesIO(files)) as archive:
        archive.extractall(folder, filter="data")
    return folder


def command(source: Path, words: Sequence[str], folder: Path) -> float:
    """Run the command of the package in a folder; return its processor seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    given = [sys.executable, "-m", "granular_lmp", *RUN, *words, "-o", str(folder / "run")]
    # Each keeps its bytecode: an environment that writes none would have the commit compiled anew in every round
    variables = os.environ | {"PYTHONPATH": str(source), "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
    subprocess.run(given, check=True, cwd=folder, env=variables, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.earlier", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("commit", nargs="?", default=FIRST, help=f"what to compare with (default {FIRST})")
    parser.add_argument("--repeats", type=int, default=9, metavar="N", help="rounds (default 9)")
    options = parser.parse_args(argv)
    with TemporaryDirectory(prefix="earlier-") as scratch:
        jobs: dict[str, Callable[[Path], float]] = {
            options.commit: partial(command, taken_out(options.commit, Path(scratch)), ()),
            "today": partial(command, ROOT, ("--no-kernel",)),
        }
        if lack := missing_kernel():
            print(f"without the kernel: {lack}", file=sys.stderr)
        else:
            jobs["today, --kernel"] = partial(command, ROOT, ("--kernel",))
        interleave(jobs, 1)  # bytecode is compiled
        done = interleave(jobs, max(options.repeats, 1))
    wall, processor = ({name: [each[k] for each in rounds] for name, rounds in done.items()} for k in (0, 1))
    first = options.commit
    lines = [
        [
            name,
            *(spread(processor[name]), both_ratios(processor[name], processor[first])),
            *(spread(wall[name]), both_ratios(wall[name], wall[first])),
        ]
        for name in jobs
    ]
    print(machine() + "\n")
    print(table(HEAD, lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
