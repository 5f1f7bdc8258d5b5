"""Crystal of a scene, and its wave to second order: any lattice, layers, law, form and direction.

Positions, contacts and modes follow from the spheres and the lattice. Rows may differ in density, in a repeating
pattern ("layers"). The wave is then a numbered branch of this crystal; or it starts as a mode of the lattice without
layers, which is a sum of modes of the crystal.

The wave may run or stand. Anything else in a scene is refused, and the error names its key.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.bloch import frame
from granular_analysis.theory.bonds import SHEAR_LAWS, Measured
from granular_analysis.theory.branches import named_branch
from granular_analysis.theory.crystal import PLANE, Crystal, Wall
from granular_analysis.theory.errors import TheoryError, one_of
from granular_analysis.theory.lattices import LATTICES, Lattice
from granular_analysis.theory.network import Elastic, mixed
from granular_analysis.theory.network_laws import ADHESIONS
from granular_analysis.theory.second_order import Mixed, Wave, second_order, started, wave
from granular_analysis.theory.validity import turned
from granular_analysis.theory.variation import Spot
from granular_lmp.runs.record import Scene

__all__ = ["Setting"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


# Keys that define the crystal or do not affect it; any other key that departs from its default is refused
CRYSTAL_KEYS = frozenset({"name", "inclusion", "pair", "monitor", "source", "disorder.seed"}).union(
    f"{section}.{key}"
    for section, keys in {
        "sphere": "radius youngs_modulus poisson_ratio work_of_adhesion density adhesion_law",
        "packing": "lattice rows columns ends contact_force relax relax_friction relax_by space layers depth "
        "orientation",
        "contact": "normal_stiffness shear_stiffness",
        "substrate": "youngs_modulus poisson_ratio work_of_adhesion normal_stiffness shear_stiffness sides density",
        "wave": "mode wavenumber frequency amplitude phase form direction",
        "envelope": "length width offset ramp",
        "time": "duration timestep tolerance sample allow_echo",
        "effects": "adhesion shear rotation tracking sliding contact_opening shear_law friction",
        "output": "particles checkpoint",
        "absorb": "rows reflection",
    }.items()
    for key in keys.split()
)
# Keys that change the motion of a wave that fills the crystal; the two effects do so only if they are on
MOTION = frozenset(
    {"source", "envelope.length", "envelope.width", "absorb.rows", "effects.sliding", "effects.contact_opening"}
)
FORMS = ("running", "standing")
DEFAULT = {"cubic": "[001]", "fcc": "[001]", "hcp": "c"}  # orientation if the scene has "auto"
_NEWTON = 12  # steps; each doubles the digits from the third on
LONGEST = 6  # most rows of a pattern: its modes interact in pairs, which takes 10 s of processor time for six rows


# CONTACT: keys of the overlap at rest, in the order of its formula. VARIED: these and the other keys whose value may
# vary, beside "inclusion.N.density"
CONTACT = {f"sphere.{name}": None for name in ("radius", "youngs_modulus", "poisson_ratio", "work_of_adhesion")} | {
    "packing.contact_force": None
}
VARIED = (*CONTACT, "sphere.density", "wave.direction")


def declared(key: str, value: Any) -> str:
    """Return a key and its value as in a scene file: "time.duration = 3.0", "2 tables [[source]]"."""
    if isinstance(value, tuple) and value and not isinstance(value[0], int | float | str | tuple):
        return f"{len(value)} table{'s' * (len(value) > 1)} [[{key}]]"
    return f"{key} = {value!r}"


def need_wave(scene: Scene) -> None:
    """Raise TheoryError for a scene without a wave, such as one that has only strikers or a state."""
    if scene.wave is None:
        raise TheoryError("wave: missing table; this theory needs a wave")


@dataclass(frozen=True, eq=False)
class Setting:
    """Physics of a scene for the theory of a crystal, in SI units.

    Attributes
    ----------
    scene : scene, whose "auto" may be decided or not; an effect that is still "auto" is on if every crystal has it.
    numbers : values that replace those of some keys: `VARIED`, "inclusion.N.density" with N from 1, and
        "wave.wavenumber", which a periodic cell then does not round. They may be complex, for
        `granular_analysis.theory.variation`.
    """

    scene: Scene
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        need_wave(self.scene)

    def refuse(self, allowed: frozenset[str]) -> None:
        """Raise TheoryError if any key outside `allowed` departs from its default, unless it is False."""
        departs = {key for key, value in self.scene.departures().items() if value is not False}
        if other := sorted(departs - allowed):
            values = ", ".join(declared(key, self.scene.departures()[key]) for key in other)
            raise TheoryError(f"the theory of a crystal leaves out {values}")

    def number(self, key: str) -> Any:
        """Return the value of a numeric key, from `numbers` or else from the scene."""
        section, _, name = key.partition(".")
        if key in self.numbers:
            return self.numbers[key]
        if key == "sphere.work_of_adhesion" and self.scene.effects.adhesion is False:
            return 0.0
        return getattr(self.scene.material if section == "sphere" else getattr(self.scene, section), name)

    @property
    def lattice(self) -> Lattice:
        """Return the lattice, in units of the distance of two spheres."""
        name, orientation = self.scene.packing.lattice, self.scene.packing.orientation
        return LATTICES[name, orientation if orientation != "auto" else DEFAULT.get(name, "")]

    @property
    def stacked(self) -> bool:
        """Return whether the crystal is a stack of layers, finite along z: a film, free or on a substrate."""
        scene = self.scene
        return self.lattice.layer > 0 and (scene.substrate is not None or scene.packing.depth == "free")

    def places(self, rows: int) -> tuple[Floats, Floats, NDArray[np.intp]]:
        """Return vectors (d, 3), positions (B, 3) and rows (B,) of a cell with a pattern of `rows` rows.

        The unit is the distance of two spheres. Raises TheoryError for a pattern that the lattice cannot have.
        """
        if rows > 1 and not self.stacked:
            return self.lattice.rows(rows)
        if rows > 1:
            raise TheoryError("inclusion: rows of other densities need one layer of spheres or a crystal without faces")
        layers = self.scene.packing.layers
        film = self.lattice.film(1 if layers == "auto" else int(layers)) if self.stacked else self.lattice[:2]
        return *film, np.zeros(len(film[1]), dtype=np.intp)

    def walls(self, place: Floats, material: Elastic) -> list[Wall]:
        """Return the walls of the substrate for spheres of a material at positions (B, 3), in m."""
        substrate = self.scene.substrate
        if substrate is None:
            return []
        half_space = Elastic(substrate.youngs_modulus, substrate.poisson_ratio, substrate.work_of_adhesion)
        radius, ends = self.number("sphere.radius"), (np.array([0]), np.array([1]))
        hertz, _, pull, _ = mixed([material, half_space], ends, (np.array([radius]), np.array([np.inf])))
        # Overlap without force: A δ^{3/2} = F by the DMT law, A (3δ)^{3/2} = 3F by the JKR law
        overlap = (pull[0] / hertz[0]) ** (2 / 3) / (1 if self.scene.sphere.adhesion_law == "dmt" else 3 ** (1 / 3))
        away, floor, ceiling = radius - overlap, place[:, 2].min(), place[:, 2].max()
        below = Wall((0.0, 0.0, floor - away), (0.0, 0.0, -1.0), half_space)
        above = Wall((0.0, 0.0, ceiling + away), (0.0, 0.0, 1.0), half_space)
        return [below, above] if substrate.sides == "both" else [below]

    @property
    def measured(self) -> Measured:
        """Return the measured stiffnesses of the scene."""
        pair, wall = self.scene.contact, self.scene.substrate
        of_wall = (None, None) if wall is None else (wall.normal_stiffness, wall.shear_stiffness)
        pairs = tuple(((*each.of,), (each.normal_stiffness, each.shear_stiffness)) for each in self.scene.pair)
        return Measured(pair.normal_stiffness, pair.shear_stiffness, *of_wall, pairs)

    @cached_property
    def pattern(self) -> tuple[NDArray[Any], NDArray[np.intp]]:
        """Return the density and the kind of each row of the repeating pattern, (P,) each, the centre row first.

        If the density of an inclusion is varied, or [[pair]] names it, its rows have its number as kind, even if their
        density equals that of other rows. All other rows have kind 0.

        Raises TheoryError if the inclusions do not form a pattern of rows of other densities.
        """
        scene, shape = self.scene, self.scene.shape
        if not scene.inclusion:
            return np.array([self.number("sphere.density")]), np.zeros(1, dtype=np.intp)
        rows = np.full(shape.rows, self.number("sphere.density"))
        kinds, named = np.full(shape.rows, scene.sphere.density), {kind for pair in scene.pair for kind in pair.of}
        for number, each in enumerate(scene.inclusion, 1):
            differs = {name for name, value in vars(each).items() if value != getattr(type(each)(), name)}
            if other := sorted(differs - {"rows", "every", "density"}):
                raise TheoryError(f"inclusion {number} has {', '.join(other)}; allowed: rows, every, density")
            varied = self.numbers.get(f"inclusion.{number}.density")
            first, last = each.rows
            chosen = slice(first, last + 1, each.every)
            rows = rows.astype(np.result_type(rows, 0.0 if varied is None else varied))
            rows[chosen] = each.density if varied is None else varied
            kinds[chosen] = each.density if varied is None and number not in named else -number
        shift = self.lattice.repeats
        if shape.ends == "periodic":
            fits = (
                n
                for n in range(shift, LONGEST + 1, shift)
                if len(kinds) % n == 0 and np.all(kinds == np.roll(kinds, n))
            )
        else:
            fits = (n for n in range(shift, LONGEST + 1, shift) if np.all(kinds[n:] == kinds[:-n]))
        length = next(fits, 0)
        if not length:
            raise TheoryError(f"the densities of {len(rows)} rows do not repeat after {LONGEST} rows or fewer")
        if np.ptp(kinds) == 0:
            length = 1
        of_row = np.maximum(-kinds, 0).astype(np.intp)
        density, kind = (np.roll(each, -shape.centre_row)[:length] for each in (rows, of_row))
        return density, kind

    @property
    def densities(self) -> NDArray[Any]:
        """Return the density (P,) of each row of the pattern."""
        return self.pattern[0]

    @cached_property
    def overlap(self) -> Any:
        """Return the overlap at rest of two spheres, in m.

        Raises TheoryError if it is varied under the JKR law, which has no closed form.
        """
        sphere = self.scene.sphere
        if not self.numbers.keys() & CONTACT:
            return sphere.static_overlap
        if sphere.adhesion_law != "dmt":
            varied = ", ".join(sorted(self.numbers.keys() & CONTACT))
            raise TheoryError(f"{varied}: must not vary with adhesion_law = {sphere.adhesion_law!r}; take 'dmt'")
        radius, modulus, ratio, adhesion, pressed = (self.number(key) for key in CONTACT)
        hertz = 2 / 3 * modulus / (1 - ratio**2) * np.sqrt(radius / 2)
        pull, stiffness = np.pi * adhesion * radius, self.scene.contact.normal_stiffness  # 2πw Rc, Rc = R/2
        if stiffness is None:
            return ((pull + pressed) / hertz) ** (2 / 3)
        # The law is scaled to this stiffness K at rest: (2/3)K(δ − F/A√δ) = F0; Newton's method for √δ, from above
        slope, level = 1.5 * pressed / stiffness, pull / hertz
        root = slope**0.5 + level ** (1 / 3)
        for _ in range(_NEWTON):
            root = root - (root**3 - slope * root - level) / (3 * root**2 - slope)
        return root**2

    def crystal(self, *, layers: bool = True, true_geometry: bool = True) -> Crystal:
        """Return the crystal with its pattern of rows; without `layers`, the plain lattice of the mode of the wave.

        With `layers`, raises TheoryError for anything that the theory leaves out, such as dashpots, rolling resistance,
        disorder, or inclusions that do not form a pattern of rows.
        """
        if layers:
            self.refuse(CRYSTAL_KEYS)
        sphere, effects = self.scene.sphere, self.scene.effects
        density, kind = self.pattern if layers else (np.array([sphere.density]), np.zeros(1, dtype=np.intp))
        vectors, place, row = self.places(len(density))
        material = Elastic(
            *(self.number(f"sphere.{name}") for name in ("youngs_modulus", "poisson_ratio", "work_of_adhesion"))
        )
        place, components = self.spacing * place, 3 if self.scene.space == 3 else 2
        return Crystal.of(
            self.spacing * vectors[:, :components],
            place[:, :components],
            self.number("sphere.radius"),
            density[row],
            [material] * (max(kind) + 1),
            kind=kind[row],
            walls=self.walls(place, material),
            adhesion=one_of(ADHESIONS, sphere.adhesion_law, "sphere.adhesion_law"),
            shear_law=one_of(SHEAR_LAWS, effects.shear_law, "effects.shear_law"),
            shear=effects.shear is not False,
            rotation=effects.rotation is not False,
            true_geometry=true_geometry,
            measured=self.measured,
        )

    @property
    def spacing(self) -> Any:
        """Return the lattice constant, in m."""
        if not self.numbers.keys() & CONTACT:
            return self.scene.sphere.lattice_constant
        return 2 * self.number("sphere.radius") - self.overlap

    def spot(self) -> Spot:
        """Return the spot: the crystal with wave vectors along the wave's direction; wave numbers in rad per row."""
        turn = self.numbers.get("wave.direction", self.scene.direction) * np.pi / 180
        height = self.lattice.row * self.spacing
        return Spot(self.crystal(), np.array([np.cos(turn), np.sin(turn), 0 * turn]) / height, self.overlap)

    @property
    def unit(self) -> float:
        """Return the wave number of 1 rad per row, in 1/m."""
        return float(1 / (self.lattice.row * self.scene.sphere.lattice_constant))

    def wavevector(self, wavenumber: ArrayLike | None = None) -> Floats:
        """Return k (..., 2) in 1/m at wave numbers ξ (...) in rad per row; None: the wave number of the wave."""
        own = self.numbers.get("wave.wavenumber", self.scene.wavenumber)
        xi = np.asarray(own if wavenumber is None else wavenumber, dtype=float)
        return np.multiply.outer(xi * self.unit, frame(self.scene.direction)[0])

    def mode(self) -> Wave:
        """Return the wave of the scene with amplitude 1, as a mode of the lattice without layers.

        The waves of a plane lattice with one sphere per cell have names. If the scene gives a number instead, the wave
        is that branch of the crystal with layers. In a cell of several spheres, the squares of their amplitudes sum
        to 1.
        """
        plain, k = self.crystal(layers=False), self.wavevector()
        name = self.scene.require_wave().mode
        counted = name.isdecimal() and len(plain) == 1 and self.scene.space == 2
        lattice = self.crystal() if counted else plain
        return wave(lattice, k, named_branch(lattice, k, name)).times(1 / np.sqrt(len(lattice)))

    def start(self) -> tuple[Crystal, tuple[Wave, ...]]:
        """Return the crystal and the initial waves of the scene, with displacements in m.

        Raises TheoryError for a form of wave other than `FORMS`, and for anything else that moves spheres.
        """
        self.refuse(CRYSTAL_KEYS - MOTION)
        own = self.scene.require_wave()
        if own.form not in FORMS:
            raise TheoryError(f"wave.form = {own.form!r}; allowed: {', '.join(FORMS)}")
        scene, crystal, mode = self.scene, self.crystal(), self.mode()
        size = scene.displacement_amplitude * np.exp(1j * own.phase)
        field = np.tile(size * mode.shape, (len(crystal) // len(mode.shape), 1))
        rate = np.zeros_like(field) if own.form == "standing" else -1j * mode.frequency * field
        return crystal, started(crystal, mode.wavevector, field, rate)

    def signals(self, tau: ArrayLike) -> tuple[tuple[Floats, Floats, Floats], tuple[Floats, Floats, Floats]]:
        """Return the first and the second order of p, q, φ of the centre sphere, (T,) each, in units of D0.

        tau : (T,) times in t0.
        """
        scene = self.scene
        crystal, waves = self.start()
        orders = second_order(crystal, waves, np.asarray(tau, dtype=float) * scene.sphere.time_scale)
        parts = []
        for order in orders:
            moved = order[:, 0, list(PLANE)] / scene.displacement_amplitude
            p, q = frame(scene.direction) @ moved[:, :2].T
            parts.append((p, q, moved[:, 2]))
        return parts[0], parts[1]

    def harmonic(self, tau: ArrayLike) -> tuple[Complexes, Floats]:
        """Return the second harmonic and an estimate of the error of its phase.

        The second harmonic is Re[C e^{2ik·r}] with C (T, 2) along and across k, in units of D0; with layers, C is the
        mean over the spheres of a cell, and r is measured from the centre sphere. The error (T,) is twice the phase
        shift of the waves by third order, in rad (`granular_analysis.theory.validity.turned`).
        """
        scene = self.scene
        crystal, waves = self.start()
        t = np.asarray(tau, dtype=float) * scene.sphere.time_scale
        moved: Complexes = np.zeros((len(t), 2), dtype=complex)
        for i, j in combinations_with_replacement(range(len(waves)), 2):
            field = Mixed(crystal, waves[i], waves[j]).signal(t)[..., :2].mean(axis=1)
            moved += field * (0.5 if i == j else 1.0)
        scaled: Complexes = moved @ frame(scene.direction).T / scene.displacement_amplitude
        return scaled, 2 * turned(crystal, waves, t)
