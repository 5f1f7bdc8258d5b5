"""LAMMPS: its decks, contact laws, units, guards and output files."""
