"""Commands of granular-analysis; `compare` also has functions for scripts."""
