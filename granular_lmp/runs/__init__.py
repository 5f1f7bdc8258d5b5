"""Runs: one deck in one run folder, from the launch to the record."""
