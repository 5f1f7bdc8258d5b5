"""Derived values of a scene: spheres at rest, units, shape, frequencies, and the table of refusals."""
