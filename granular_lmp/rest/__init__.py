"""What follows from a declaration: spheres at rest, units, shape, frequencies, and what does not go together."""
