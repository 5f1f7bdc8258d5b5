"""Plots: pictures and movies of runs and sweeps."""
