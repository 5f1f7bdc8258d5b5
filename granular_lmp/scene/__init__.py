"""The scene: the user's declaration of a simulation, checked value by value."""
