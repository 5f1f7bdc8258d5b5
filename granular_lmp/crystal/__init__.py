"""Crystals: spheres at rest, their contacts and their linear waves, independent of scenes and LAMMPS."""
