"""Run the tests that depend on last digits as other processors would: ``python -m tests.processors``.

OpenBLAS and NumPy choose their code by what the processor can do, and OpenBLAS sums in another order with another
number of threads. Each of two settings takes another choice of all three; without AVX-512 the wide one is Zen in place
of SkylakeX, and what this processor cannot run is named and left out; where it can run none the tests run as it is.
`make test` runs these tests here only.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

TESTS = Path(__file__).parent
AS_IT_IS = "this processor"
MANY = "4"  # threads, also where there are fewer cores: the order of the sums is what counts
# The features that NumPy chooses between here; each of the two names is that of one generation of NumPy
FOUND: list[str] = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
AVX2 = bool({"AVX2", "X86_V3"} & set(FOUND))
AVX512 = bool({"AVX512_SKX", "X86_V4"} & set(FOUND))

# Core that OpenBLAS takes this one for, whether this one can stand in for it, features that NumPy leaves out, threads
SETTINGS = [
    ("Haswell", AVX2, FOUND, "1"),
    ("SkylakeX" if AVX512 else "Zen", AVX2, [], MANY),
]
if not any(can_run for _, can_run, _, _ in SETTINGS):
    SETTINGS.append((AS_IT_IS, True, [], MANY))


def environment(core: str, left_out: list[str], threads: str) -> dict[str, str]:
    """Return the variables of this process with those of a setting."""
    chosen = {} if core == AS_IT_IS else {"OPENBLAS_CORETYPE": core, "NPY_DISABLE_CPU_FEATURES": " ".join(left_out)}
    return os.environ | chosen | {"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}


def main() -> int:
    """Run all settings side by side; return 1 if a test fails under one of them."""
    files = [path for path in sorted(TESTS.rglob("test_*.py")) if "mark.rounding" in path.read_text("utf-8")]
    command = [sys.executable, "-m", "pytest", "-q", "-m", "rounding", "-p", "no:cacheprovider", *files]
    begun = time.perf_counter()
    runs = {
        core: subprocess.Popen(command, env=environment(core, left_out, threads), stdout=subprocess.PIPE, text=True)
        for core, can_run, left_out, threads in SETTINGS
        if can_run
    }
    failed = False
    for core, _, left_out, threads in SETTINGS:
        setting = f"{core}, NumPy without {' '.join(left_out) or 'nothing'}, {threads} threads"
        if core not in runs:
            print(f"{setting}: this processor cannot run it")
            continue
        output, _ = runs[core].communicate()
        failed |= runs[core].returncode != 0
        print(f"{setting}: {output.splitlines()[-1]}" if runs[core].returncode == 0 else f"{setting}:\n{output}")
    print(f"{time.perf_counter() - begun:.0f} s")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
