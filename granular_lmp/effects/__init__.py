"""Effects: the physics that a scene calls for, one effect per file."""
