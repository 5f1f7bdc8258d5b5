"""The command line as ``python -m granular_lmp``."""

import sys

from granular_lmp.cli import program

if __name__ == "__main__":  # mpi4py.futures reads this file in every rank
    sys.exit(program())
