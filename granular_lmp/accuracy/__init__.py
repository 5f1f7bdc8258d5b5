"""Accuracy: choice of a time step and estimate of an error, from runs only."""
