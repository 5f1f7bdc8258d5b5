"""Other particle codes on the same problem. Each is skipped, and said so, where it is not installed."""
