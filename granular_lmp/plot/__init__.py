"""Pictures and movies of runs and sweeps."""
