"""Lattices that just touch, compressed chains, and what strikes them: scene, spheres, deck, run and record."""
