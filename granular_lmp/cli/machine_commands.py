"""Commands about this machine: doctor."""

import argparse

from granular_lmp.cli.arguments import Commands, Options, add
from granular_lmp.cli.output import say


def add_to(commands: "Commands[argparse.ArgumentParser]") -> None:
    """Add these commands to the parser."""
    add(commands, "doctor", _doctor, "tell what was found: LAMMPS, its packages, MPI, cores; run a short self-test")


def _doctor(options: Options) -> int:
    from granular_lmp.doctor import report

    return report(say)
