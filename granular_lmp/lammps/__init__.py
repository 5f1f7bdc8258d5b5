"""Everything that is written for LAMMPS or read from it."""
