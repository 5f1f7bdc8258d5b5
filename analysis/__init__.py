"""Theory and post-processing of waves in granular crystals, independent of granular_lmp's own physics.

The package is `granular_analysis`. The folder's own name is the same package for scripts that were written with it:
`analysis.X` is the module `granular_analysis.X`, unless another `analysis` stands before it on the path.
"""

import os
import sys

_BLAS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")

# Matrices here are of 31×31, which threads of BLAS only delay; it asks when NumPy is imported. That is for
# `python -m granular_analysis.…`: who imports the package from elsewhere keeps the threads, as does who has set them.
_as_script = sys.argv[:1] == ["-m"] and any("analysis." in word for word in sys.orig_argv)
if _as_script and not any(name in os.environ for name in _BLAS):
    os.environ.update(dict.fromkeys(_BLAS, "1"))

if __name__ == "analysis":
    from granular_analysis.short_name import ShortName

    sys.meta_path.insert(0, ShortName())
