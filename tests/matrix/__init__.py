"""Which features of a scene go together: every pair is built, and the result is held in golden files."""
