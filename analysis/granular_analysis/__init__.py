"""Theory and post-processing of waves in granular crystals, independent of the physics in granular_lmp.

Read `second_harmonic` first: it has the closed form and needs only NumPy. `theory` goes beyond it, `measure` reads
runs, and `tools` has the scripts of the command ``granular-analysis``.
"""
