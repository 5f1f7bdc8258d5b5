"""Theory and post-processing of plane waves in a granular crystal, independent of granular_lmp's own physics."""
