"""Decks that people bring themselves: how LAMMPS reads them, and what can be wrong with them."""
