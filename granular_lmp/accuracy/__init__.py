"""How a time step is chosen and an error estimated, from runs alone."""
