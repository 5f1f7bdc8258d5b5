"""Declared values of a scene file, checked one by one; derived values stand in `granular_lmp.rest`."""
