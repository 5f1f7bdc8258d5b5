"""Scenes with known keys, whose frequencies are fitted again with noise: how often the intervals hold the truth."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.fitting import Fit
from granular_analysis.measure.points import Point
from granular_lmp import Scene

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Setup:
    """A scene with its true keys, and the places of the points: each of the branches at each wave number."""

    name: str
    scene: Scene
    truth: Mapping[str, float]
    wavenumbers: tuple[float, ...]
    branches: tuple[str, ...]

    @cached_property
    def exact(self) -> list[Point]:
        """Return the points without noise."""
        places = [(xi, branch) for xi in self.wavenumbers for branch in self.branches]
        points = [
            Point("frequency", 1.0, 1.0, line, branch=branch, wavenumber=xi)
            for line, (xi, branch) in enumerate(places, 2)
        ]
        hertz = Fit(self.scene, points, tuple(self.truth)).predicted(np.array([*self.truth.values()]))
        return [Point(**vars(each) | {"value": float(value)}) for each, value in zip(points, hertz, strict=True)]

    def departures(self, noise: float, sets: int, seed: int = 1) -> Floats:
        """Return the departure of each key of each set over half the width of its interval, (sets, P).

        Fits start 10 % off. A departure is taken in what the interval is symmetric in: the logarithm of a positive key.
        """
        rng = np.random.default_rng([seed, round(1e6 * noise), len(self.name)])
        begin = self.scene.with_values({key: 1.1 * value for key, value in self.truth.items()})
        found = []
        for _ in range(sets):
            points = [
                Point(**vars(each) | {"value": each.value * (1 + noise * rng.normal()), "error": each.value * noise})
                for each in self.exact
            ]
            answer = Fit(begin, points, tuple(self.truth)).answer()
            rows = zip(answer.parameters, answer.values, answer.intervals, self.truth.values(), strict=True)
            found.append(
                [
                    (each.inner(value) - each.inner(true)) / (each.inner(high) - each.inner(value))
                    for each, value, (_, high), true in rows
                ]
            )
        return np.array(found)


def setups() -> list[Setup]:
    """Return the sheet, the chain of two densities, whose spheres move along it and do not turn, and the monolayer."""
    sheet = Scene.load("tr_periodic")
    two_densities = {
        "packing.ends": "periodic",
        "packing.rows": 40,
        "inclusion": [{"rows": [0, 39], "every": 2, "density": 5000.0}],
    }
    chain = Scene.load("l_chain").with_values(two_densities)
    stiffnesses = {
        "substrate.normal_stiffness": 2500.0,
        "substrate.shear_stiffness": 1500.0,
        "contact.shear_stiffness": 150.0,
    }
    layer = Scene.load("monolayer_rocking").with_values(stiffnesses | {"contact.normal_stiffness": 300.0})
    six = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
    return [
        Setup("sheet", sheet, {"sphere.youngs_modulus": 7.3e10, "sphere.poisson_ratio": 0.17}, six, ("1", "2", "3")),
        Setup("chain", chain, {"sphere.youngs_modulus": 7.3e10, "inclusion.1.density": 5000.0}, six[:3], ("3", "4")),
        Setup("layer", layer, stiffnesses, (0.0, 1.5), ("S1", "S2", "S3")),
    ]


def judged(found: Floats) -> tuple[Floats, Floats]:
    """Return coverage and bias of each key, (P,), from departures (sets, P)."""
    return np.mean(np.abs(found) <= 1, axis=0), np.mean(found, axis=0)
