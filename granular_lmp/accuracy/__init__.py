"""Accuracy: the choice of a time step and the estimate of an error, from runs alone."""
