"""Runs: a deck in its run folder, from the launch to the record."""
