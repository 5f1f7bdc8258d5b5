"""Runs that are stopped at a step, however fast the machine is: LAMMPS halts there and waits; and killed ones."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from granular_lmp.runs import routes
from granular_lmp.runs.record import read_status, write_status

_INPUT, _WAITS = "in.paused", "paused"  # the second is there while LAMMPS waits
_LINES = """\
variable     paused equal 1
fix          paused all halt $(ceil(v_steps*{share!r})) v_paused > 0 error soft message no
{run}
shell        touch {waits}
shell        while [ -e {waits} ]; do sleep 0.002; done
"""


def as_if_killed(folder: Path) -> None:
    """Let ``run.json`` say what it says of a run that was killed: nothing of how it ended, or of its files."""
    left = read_status(folder) | {"status": "running"}
    write_status(folder, {key: value for key, value in left.items() if key != "files"})


@contextmanager
def paused(folder: Path, share: float = 1 / 3) -> Iterator[None]:
    """Stop the run in a folder at a share of its steps as Ctrl-C does, on any route.

    The files of the run stay as they are: LAMMPS reads an input beside them.
    """
    waits = folder / _WAITS

    def stop(step: int) -> None:
        if waits.exists():
            waits.unlink()
            raise KeyboardInterrupt

    def halting(route: Callable[..., None]) -> Callable[..., None]:
        def run(*arguments: Any) -> None:
            *others, job = arguments
            if job.folder != folder:
                return route(*others, job)
            before, run, after = (folder / job.input_name).read_text(encoding="utf-8").rpartition("\nrun ")
            command, _, verdict = after.partition("\n")
            text = f"{before}\n{_LINES.format(share=share, run=run.strip() + ' ' + command, waits=_WAITS)}{verdict}"
            (folder / _INPUT).write_text(text, encoding="utf-8")
            try:
                route(*others, replace(job, input_name=_INPUT, report_step=stop))
            finally:
                (folder / _INPUT).unlink()
                waits.unlink(missing_ok=True)

        return run

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(routes, "_POLL", 1e-3)
        for route in ("_run_module", "_run_program"):
            patch.setattr(routes, route, halting(getattr(routes, route)))
        yield
