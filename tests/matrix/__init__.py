"""Every pair of features of a scene is built, and golden files hold which go together."""
