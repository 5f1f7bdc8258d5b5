"""Optional pair style that computes contacts faster, built with the compiler of the user."""
