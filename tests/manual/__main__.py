"""Run every test of the manual with its mutant, and write the table.

    python -m tests.manual [WORD …]

With words only the cases whose tests have one of them in their names are run; the other lines stay.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from importlib.util import cache_from_source
from pathlib import Path
from typing import Any

from tests.manual import ROOT, Case, declared
from tests.manual.recorder import OUTPUT
from tests.manual.table import Row, committed, node, write

LEFT_OUT = {"figures", "runs", "site", "dist", "build"}  # and what begins with a dot


def copy_of_the_sources(folder: Path) -> None:
    """Copy what tests read, so that no change reaches the working tree."""

    def left_out(place: str, names: list[str]) -> set[str]:
        top = LEFT_OUT if Path(place) == ROOT else set()
        return {name for name in names if name in top or name == "__pycache__" or name.startswith(".")}

    shutil.copytree(ROOT, folder, ignore=left_out, symlinks=True, dirs_exist_ok=True)


def ran(folder: Path, tests: list[str]) -> list[dict[str, Any]]:
    """Return what the tests say that ran in a copy: name, outcome, whether it failed by itself, and error."""
    record = folder / "record.jsonl"
    record.unlink(missing_ok=True)
    own = {OUTPUT: str(record), "PYTHONPATH": str(folder), "XDG_CACHE_HOME": str(folder / ".cache")}
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "--rootdir", str(folder)]
    done = subprocess.run(
        [*command, *tests], cwd=folder, env=os.environ | own, capture_output=True, text=True, check=False
    )
    if not record.exists():
        raise SystemExit(f"{' '.join(tests)} did not run:\n{done.stdout}\n{done.stderr}")
    return [json.loads(line) for line in record.read_text("utf-8").splitlines()]


def worst_of(said: list[dict[str, Any]]) -> tuple[str, float]:
    """Return the test with the largest error of a case that passes, and that error.

    Raises
    ------
    ValueError
        If one of its tests fails as it is.
    """
    if {each["outcome"] for each in said} != {"passed"}:
        raise ValueError("fails as it is")
    worst = max(said, key=lambda each: float(each["error"]))
    return worst["test"], worst["error"]


def rewrite(file: Path, text: str) -> None:
    """Write a source, and drop what was compiled of it: a change of the same size in the same second goes unseen."""
    file.write_text(text, "utf-8")
    if file.suffix == ".py":
        Path(cache_from_source(str(file))).unlink(missing_ok=True)


def with_mutant(folder: Path, name: str, case: Case) -> float | None:
    """Return the largest error of a case with its mutant, None where the test fails before it measures one.

    Raises
    ------
    ValueError
        If no test fails, or one does so by anything but an assertion of its own.
    """
    file = folder / case.mutant.file
    text = file.read_text("utf-8")
    try:
        rewrite(file, case.mutant.applied(text))
        failed = [each for each in ran(folder, [name]) if each["outcome"] == "failed"]
    finally:
        rewrite(file, text)
    if not failed or not all(each["own"] for each in failed):
        raise ValueError(f"{failed or 'passes'} with {case.mutant}: must fail by an assertion of its own")
    errors = [each["error"] for each in failed if each["error"] is not None and each["error"] > case.tolerance]
    return max(errors, default=None)


def kept(line: dict[str, str], case: Case) -> Row:
    """Return the row of a line that is not run anew."""
    changed = line["with the change"]
    return Row(case, node(line), float(line["measured"]), None if changed == "fails" else float(changed))


def main() -> str:
    """Run the cases of the words, or all, write the table, and return what is wrong with them, a line each."""
    parser = argparse.ArgumentParser(prog="python -m tests.manual", description=__doc__.split("\n")[0])
    parser.add_argument("words", nargs="*", metavar="WORD", help="only the tests that have one of these in their names")
    words = parser.parse_args().words
    cases = {name: case for name, case in declared().items() if not words or any(word in name for word in words)}
    if absent := [word for word in words if not any(word in name for name in cases)]:
        parser.error(f"no test of the manual has {', '.join(absent)} in its name")
    rows = {name: kept(line, declared()[name]) for name, line in committed().items() if name in declared()}
    wrong = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        copy_of_the_sources(folder)
        before = ran(folder, list(cases))
        for name, case in cases.items():
            try:
                test, error = worst_of([each for each in before if each["test"].partition("[")[0] == name])
                rows[name] = Row(case, test, error, with_mutant(folder, name, case))
            except ValueError as problem:
                wrong.append(f"{name}: {problem}")
            else:
                print(*rows[name].cells()[2:5], name, flush=True)
                write(rows)
    return "\n".join(wrong)


if __name__ == "__main__":
    sys.exit(main() or 0)
