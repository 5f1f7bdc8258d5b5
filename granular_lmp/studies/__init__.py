"""Many runs: sweeps, a kicked sheet, collisions, cost."""
