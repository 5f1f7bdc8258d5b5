"""Theory and post-processing of waves in granular crystals, independent of granular_lmp's own physics.

Read `second_harmonic` first: the closed form, with NumPy alone. `theory` goes beyond it, `measure` reads runs, and
`tools` are the scripts of the command ``granular-analysis``.
"""
