"""Studies: sweeps, scattering, kicked sheets, collisions, and the cost of accuracy."""
