"""The scripts of analysis take one thread of BLAS; whoever imports analysis, or has set the threads, keeps theirs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROGRAM = "from granular_analysis.cli import program; import sys; sys.argv[1:] = ['--help']; program()"
SAID_AT_THE_END = "import atexit, os; atexit.register(lambda: print(os.environ.get('OPENBLAS_NUM_THREADS')))"


@pytest.mark.parametrize(
    ("arguments", "chosen", "expected"),
    [
        (["-c", PROGRAM], {}, "1"),
        (["-c", PROGRAM], {"OPENBLAS_NUM_THREADS": "3"}, "3"),
        (["-c", "import granular_analysis.measure.norms"], {}, "None"),
    ],
    ids=["script", "script, OpenBLAS set", "import"],
)
def test_only_a_script_takes_one_thread(
    arguments: list[str], chosen: dict[str, str], expected: str, tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(SAID_AT_THE_END, encoding="utf-8")
    own = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    environment = own | chosen | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    done = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == expected
