"""The commands of granular-analysis; `compare` has functions for scripts, too."""
