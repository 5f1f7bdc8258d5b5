"""Theory and post-processing of waves in granular crystals, independent of granular_lmp's own physics.

Read `second_harmonic` first: the closed form, with NumPy alone. `theory` goes beyond it, `measure` reads runs, and
`tools` are the scripts of the command ``granular-analysis``.
"""

import os
import sys

_BLAS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")

# Matrices here are of 31×31, which threads of BLAS only delay; it asks when NumPy is imported. That is for
# `python -m granular_analysis.…`: who imports the package from elsewhere keeps the threads, as does who has set them.
_as_script = sys.argv[:1] == ["-m"] and any("granular_analysis." in word for word in sys.orig_argv)
if _as_script and not any(name in os.environ for name in _BLAS):
    os.environ.update(dict.fromkeys(_BLAS, "1"))
