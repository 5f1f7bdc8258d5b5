"""Declared values of a scene file, each checked by itself; `granular_lmp.rest` derives the others."""
