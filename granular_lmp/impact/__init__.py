"""Lattices that just touch, and what strikes them: the scene, its spheres, its deck, its run and its record."""
