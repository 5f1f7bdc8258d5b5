"""The optional pair style that computes contacts faster, built by the user's compiler."""
