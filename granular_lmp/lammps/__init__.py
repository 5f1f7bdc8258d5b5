"""LAMMPS: its decks, contact laws, guards and output files."""
