"""Effects: the physics that a scene needs, one effect per file."""
