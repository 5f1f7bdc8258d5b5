"""The physics that a scene calls for, one effect at a time."""
