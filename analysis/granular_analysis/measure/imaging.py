"""Images of a crystal from the recorded motion of a few spheres: which contacts or spheres differ from the scene.

A shot is a record (`granular_analysis.measure.traces`) and a scene: the crystal as it is assumed to be, with the
sources that made the record. The run has samples at the times of the record; if its steps do not allow that, the record
is interpolated with splines.

An image has one factor (`granular_analysis.theory.network_factors`) for each contact or each sphere; `OF` lists the
quantities. A missing sphere appears as a sphere without mass, or as contacts without stiffness.

When it breaks: if contacts open, close or slide, the record has a kink, and such a run is refused.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jax.tree_util import Partial
from numpy.typing import NDArray

from granular_analysis.measure.outside import sites
from granular_analysis.measure.snapshot import FirstSnapshot
from granular_analysis.measure.stepping import first_of
from granular_analysis.measure.traces import Traces, rms
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.imaging import Image, Search, Tikhonov, Trial, Variation
from granular_analysis.theory.network_factors import Run
from granular_analysis.theory.network_gradient import events, gradient
from granular_analysis.theory.network_kernels import kernels
from granular_analysis.theory.network_objectives import misfit
from granular_lmp.runs.record import Scene

__all__ = ["Shot", "Sought"]

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
# Quantity of an image: its factor of a run, and whether each contact or each sphere has a value
OF: Mapping[str, tuple[str, str]] = {
    "contact.normal_stiffness": ("normal_stiffness", "contacts"),
    "contact.shear_stiffness": ("shear_stiffness", "contacts"),
    "adhesion": ("adhesion", "contacts"),
    "density": ("density", "spheres"),
}
BOUNDS = (0.1, 5.0)
LARGEST = 6000  # most values of an image; its matrices then take some GB
PENALTIES = ("tikhonov", "tv")
_EQUAL = 1e-3  # times that differ by less than this share of the time between two samples are equal
_LOADED = 1e-6  # a contact bears a load if its force at rest exceeds this share of its force and pull-off force


@dataclass(frozen=True, eq=False)
class Shot:
    """A record and the run that predicts it.

    Attributes
    ----------
    scene : Scene
        The scene with every "auto" decided.
    first : FirstSnapshot
        The crystal at its start.
    run : Run
        The run, which records the n measured spheres at T + 1 times.
    measured, errors : (T + 1, 2f, n) array
        Motion and its errors in units of the deck, as arguments of
        `granular_analysis.theory.network_objectives.misfit`; an error is inf where nothing was measured.
    """

    scene: Scene
    first: FirstSnapshot
    run: Run
    measured: Floats
    errors: Floats

    @classmethod
    def of(cls, traces: Traces, scene: Scene, noise: float = 1.0) -> "Shot":
        """Return the shot of a record.

        Parameters
        ----------
        traces : Traces
        scene : Scene
            The scene limits the time step of the run, and its duration limits the length of the record.
        noise : float
            Standard deviation of the errors over the root mean square of the traces at the times of the run.

        Raises
        ------
        ValueError
            If the scene begins with a motion, or the record has no time or no motion after the start.
        GranularError, TheoryError
            For a place without a sphere, a sphere with two traces, and a scene that the network does not hold.
        """
        if not 0 < noise < np.inf:
            raise ValueError(f"noise = {noise:g}: must be finite and above 0, the errors over the size of the record")
        first, setting = first_of(scene)
        if np.any(first.state.motion):  # `kernels`, which give the resolution, begin at rest
            raise ValueError(
                f"{traces.said}: its scene begins with a motion; an image needs a crystal at rest and sources"
            )
        scales, network = first.scales, first.network
        spheres = traces.spheres(setting.scene, network.position)
        apart = float(traces.time[1] - traces.time[0]) / scales.second
        apart *= max(1, int(setting.step / apart + _EQUAL))
        every = int(np.ceil(apart / setting.step - _EQUAL))
        longest = min(float(traces.time[-1]) / scales.second, setting.scene.time.duration * scales.time)
        samples = int(longest / apart + _EQUAL)
        if samples < 1:
            raise ValueError(f"{traces.said}: has no time between the start and the end of the run")
        run = Run(network, first.state, apart / every, samples, every, spheres)
        measured = np.zeros((samples + 1, 2 * network.freedoms, len(spheres)))
        errors = np.full_like(measured, np.inf)
        speed = scales.metre / scales.second
        motion = traces.at(np.asarray(np.arange(samples + 1) * apart * scales.second))
        if not (size := rms(motion)):
            raise ValueError(f"{traces.said}: has no motion between the start and the end of the run")
        for name, values in motion.items():
            rate = name.startswith("velocity")
            axis, unit = "xyz".index(name[-1]), speed if rate else scales.metre
            if axis >= network.dimension:
                raise ValueError(f"{traces.said}: has {name}, and the spheres of the scene stay in a plane")
            row = axis + network.freedoms * rate
            measured[:, row] = np.nan_to_num(values) / unit
            errors[:, row] = np.where(np.isfinite(values), noise * size / unit, np.inf)
        return cls(setting.scene, first, run, measured, errors)

    @cached_property
    def objective(self) -> Partial:
        """Return χ² of the record as a function of a run."""
        return Partial(misfit, measured=self.measured, errors=self.errors)

    @property
    def points(self) -> int:
        """Return the number of measured values."""
        return int(np.isfinite(self.errors).sum())


@dataclass(frozen=True, eq=False)
class Sought:
    """A quantity to image with one or more shots of one crystal; P values.

    Attributes
    ----------
    shots : sequence of Shot
        Shots of one crystal.
    of : str
        Key of `OF`.
    kinks : bool
        Allow runs in which contacts open, close or slide; the gradient then has the one-sided derivative there.

    Raises
    ------
    ValueError
        For an unknown quantity, shots of different crystals, and no values or more than `LARGEST`.
    TheoryError
        For stiffnesses of contacts that bear a load at rest, and, unless `kinks`, for contacts that open, close or
        slide in a shot.
    """

    shots: Sequence[Shot]
    of: str
    kinks: bool = False

    def __post_init__(self) -> None:
        if self.of not in OF:
            raise ValueError(f"{self.of!r}: must be one of {', '.join(OF)}")
        one, *others = self.shots
        position = one.run.network.position
        for each in others:
            if not np.array_equal(each.run.network.position, position):
                raise ValueError(f"{each.scene.name}: must be the same crystal as {one.scene.name}")
        if not len(self.owners):
            raise ValueError(f"{one.scene.name}: has no {OF[self.of][1]} to look for")
        if len(self.owners) > LARGEST:
            raise ValueError(f"{one.scene.name}: has {len(self.owners)} values of {self.of}; must be at most {LARGEST}")
        if "stiffness" in self.of and self._loaded:
            raise TheoryError(f"{self.of}: contacts of {one.scene.name} bear a load at rest, which is not built")
        for each in self.shots:
            if (trouble := events(each.run, {}).trouble) and not self.kinks:
                raise TheoryError(
                    f"{each.scene.name}: {trouble}; an image needs records without kinks; use weaker sources"
                )

    @property
    def first(self) -> FirstSnapshot:
        """Return the crystal at its start."""
        return self.shots[0].first

    @property
    def name(self) -> str:
        """Return the name of the factor in a run."""
        return OF[self.of][0]

    @property
    def points(self) -> int:
        """Return the number of measured values in all shots."""
        return sum(each.points for each in self.shots)

    @cached_property
    def owners(self) -> Integers:
        """Return the owners of the values, (P,): the pairs of closed contacts between spheres, or the free spheres."""
        network, pairs = self.first.network, self.first.state.pairs
        if OF[self.of][1] == "spheres":
            return np.flatnonzero(network.mobility[0] > 0)
        return np.flatnonzero((pairs.overlap > pairs.normal.end) & (pairs.second < len(network.position)))

    @property
    def _loaded(self) -> bool:
        """Return whether a contact transmits a force at rest."""
        pairs, own = self.first.state.pairs, self.owners
        touches = pairs.overlap > pairs.normal.end
        force = pairs.normal.repulsion(pairs.overlap, pairs.normal.radius(pairs.overlap, touches), touches)
        return bool(np.any(np.abs(force)[own] > _LOADED * (np.abs(force) + pairs.F)[own]))

    @cached_property
    def ends(self) -> Integers:
        """Return both spheres of each contact, (P, 2); for values of spheres, the sphere twice."""
        pairs, own = self.first.state.pairs, self.owners
        return np.stack([own, own] if OF[self.of][1] == "spheres" else [pairs.first[own], pairs.second[own]], axis=1)

    @property
    def sites(self) -> tuple[Integers, Integers]:
        """Return the row and the column of each sphere, (N,) each."""
        return sites(self.shots[0].scene, self.first.network.position)

    @cached_property
    def places(self) -> Floats:
        """Return the middle of each contact, or the place of each sphere, (P, d) in m."""
        place, pairs = self.first.network.position[self.ends[:, 0]], self.first.state.pairs
        if OF[self.of][1] == "contacts":
            place = place + pairs.apart[:, self.owners].T / 2
        return place * self.first.scales.metre

    @cached_property
    def neighbours(self) -> Integers:
        """Return pairs of neighbouring values, (E, 2): contacts that share a sphere, or spheres that touch."""
        number = np.full(len(self.first.network.position), -1)
        if OF[self.of][1] == "spheres":
            number[self.owners] = np.arange(len(self.owners))
            pairs = self.first.state.pairs
            touch = (pairs.overlap > pairs.normal.end) & (pairs.second < len(number))
            found = number[np.stack([pairs.first[touch], pairs.second[touch]], axis=1)]
            return np.asarray(found[(found >= 0).all(axis=1)])
        ends, contacts = self.ends.ravel(), np.repeat(np.arange(len(self.ends)), 2)
        own = [contacts[ends == sphere] for sphere in np.unique(ends)]
        return np.concatenate([each[np.stack(np.triu_indices(len(each), 1), axis=1)] for each in own])

    def factors(self, values: Floats) -> dict[str, Floats]:
        """Return the factors of a run that has the values (P,) of the image, and 1 everywhere else."""
        found = self.shots[0].run.neutral(self.name)
        found[self.name][self.owners] = values
        return found

    def misfit(self, values: Floats) -> tuple[float, Floats]:
        """Return χ² of all shots at values (P,), and its gradient (P,)."""
        factors = self.factors(values)
        found = [gradient(each.run, each.objective, factors, kinks=True) for each in self.shots]
        return sum(chi for chi, _ in found), np.sum([slope[self.name][self.owners] for _, slope in found], axis=0)

    @cached_property
    def curvature(self) -> Floats:
        """Return the curvature 2 JᵀJ of χ² for weak waves, (P, P), where all values are 1."""
        found = np.zeros((len(self.owners), len(self.owners)))
        for each in self.shots:
            for row, sphere, slopes in kernels(each.run, self.name, self.owners, each.errors):
                weighted = slopes / each.errors[:, row, sphere, None]
                found += 2 * weighted.T @ weighted
        return found

    def trouble(self, values: Floats) -> str:
        """Return a sentence on the contacts that opened, closed or slid with values (P,); "" if none did."""
        factors = self.factors(values)
        return "; ".join(filter(None, (events(each.run, factors).trouble for each in self.shots)))

    def image(
        self,
        penalty: str = "tikhonov",
        *,
        known: bool = True,
        bounds: tuple[float, float] = BOUNDS,
        told: Callable[[Trial], None] = lambda _: None,
        kept: Sequence[Trial] = (),
    ) -> Image:
        """Return the image: the values that minimise χ² plus a weighted penalty (`granular_analysis.theory.imaging`).

        Parameters
        ----------
        penalty : str
            One of `PENALTIES`.
        known : bool
            True if the errors of the shots are the true errors of the records: then χ² = N chooses the weight.
            Otherwise, or if χ² stays above N, the corner of the L-curve does.
        bounds : pair of float
            Lower and upper bound of all values, below and above 1.
        told : callable
            Called with each trial, for progress.
        kept : sequence of Trial
            Earlier trials of the same image, which are not made again.

        Raises
        ------
        ValueError
            For an unknown penalty, and for bounds that do not enclose 1.
        """
        if penalty not in PENALTIES:
            raise ValueError(f"penalty = {penalty!r}: must be one of {', '.join(PENALTIES)}")
        if not 0 < bounds[0] < 1 < bounds[1] < np.inf:
            raise ValueError(f"bounds {bounds[0]:g} and {bounds[1]:g}: must be below and above 1, and positive")
        of = Tikhonov() if penalty == "tikhonov" else Variation(self.neighbours)
        search = Search(self.misfit, self.curvature, self.points, of, bounds, known, told, kept)
        return search.image(np.ones(len(self.owners)))
