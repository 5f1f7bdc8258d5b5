"""Spheres at rest and their contacts; knows no scene and no LAMMPS."""
