"""A user wrote this last year, with a run folder, numpy, and the closed form. It works before and after any change."""

import sys

import numpy as np

from granular_analysis.second_harmonic import mode, ratios, second_harmonic

folder, wavenumber, amplitude, poisson_ratio = sys.argv[1], *map(float, sys.argv[2:])
tau, p, q, phi = np.loadtxt(f"{folder}/trajectory.csv", delimiter=",", skiprows=1).T
with open(f"{folder}/dump.centre", encoding="utf-8") as stream:
    snapshots = stream.read().split("ITEM: TIMESTEP\n")[1:]
columns = snapshots[0].splitlines()[7].split()[2:]
dump = dict(zip(columns, np.array([each.splitlines()[8].split() for each in snapshots], dtype=float).T, strict=True))
constants = ratios(poisson_ratio)
theory = second_harmonic(mode("TR", wavenumber, constants), constants, amplitude, tau)
error = np.linalg.norm(p - theory) / np.linalg.norm(theory)
