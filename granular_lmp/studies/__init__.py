"""Studies: sweeps, kicked sheets, collisions, and the cost of accuracy."""
