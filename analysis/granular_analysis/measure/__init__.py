"""Measurements on runs, and their distance from a theory."""
