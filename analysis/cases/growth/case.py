"""Growth of second harmonics on a resonance, in LAMMPS and in theory: layers, and waves along a row of contacts.

    granular-analysis case growth
    granular-analysis growth RUN... [-o FILE]

Each run has snapshots, and a partner of the opposite phase. Half the sum of the two is of second order. Its part at 2k
is projected on the resonant branch, B(τ), and fitted with the functions of theory: a part that grows with the detuning
δ as ∫₀^τ e^{iδs} ds, and waves of constant amplitude, at each sum of two frequencies of the waves at the start and at
the frequency of the branch. So LAMMPS gives a growth in a period, relative to the amplitude of its own wave. The table
compares it with theory, in units of the amplitude D0 of the wave per a = D0/Δ0.

The figure is for layers, rows of two alternating densities: growth over the density, whose maximum is the result of
``granular-analysis design``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cases.runner import script
from granular_analysis.measure.runs import all_but
from granular_analysis.plotting import page
from granular_analysis.theory.crystal import PLANE, Crystal
from granular_analysis.theory.phase_matching import matches
from granular_analysis.theory.scenes import Setting
from granular_analysis.theory.second_order import Wave
from granular_analysis.theory.variation import Spot, Varied, resonance
from granular_lmp.runs.record import Record, Scene

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

UNIFORM = 0.0316  # growth of the second harmonic at the resonance of the uniform crystal along y


@dataclass(frozen=True, eq=False)
class Growing:
    """The resonance of a scene's crystal next to the wave of the scene.

    Attributes
    ----------
    setting : the crystal and the wave.
    branch, target : branch of the wave, and branch of the second harmonic, counted from 0.
    near : wave number of the resonance, rad per row.
    """

    setting: Setting
    branch: int
    target: int
    near: float

    @classmethod
    def of(cls, scene: Scene) -> "Growing":
        """Return the growing resonance next to the wave number of a scene; raise ValueError if there is none."""
        setting = Setting(scene)
        unit = np.linalg.norm(setting.spot().unit)
        found = [each for each in matches(setting.crystal(), setting.spot().unit) if each.rate > 0]
        if not found:
            raise ValueError(f"{scene.name}: no second harmonic grows in this direction")
        next_to = min(found, key=lambda each: abs(each.wavenumber / unit - scene.wavenumber))
        return cls(setting, next_to.branch, next_to.target, float(next_to.wavenumber / unit))

    @property
    def theory(self) -> float:
        """Return the growth in a period per a, at the wave number of the scene."""
        at = Varied(lambda _: self.setting.spot(), np.zeros(0), self.setting.scene.wavenumber)
        return at.growth(self.branch, self.target).value

    def over(self, densities: Floats) -> Floats:
        """Return the growth at the resonance for other densities of the first inclusion, followed from its own."""
        scene = self.setting.scene

        def place(values: NDArray[Any]) -> Spot:
            return Setting(scene, {"inclusion.1.density": values[0]}).spot()

        own = float(scene.inclusion[0].density or scene.sphere.density)
        order = np.argsort(np.abs(densities - own))
        growths, known = np.empty(len(densities)), {own: self.near}
        for number in order:
            density = float(densities[number])
            near = known[min(known, key=lambda each: abs(each - density))]
            found = resonance(place, [density], self.branch, self.target, near)
            growths[number], known[density] = found.growth.value, found.wavenumber.value
        return growths


def measured(growing: Growing, records: Sequence[Record]) -> float:
    """Return the growth in a period per a in two runs whose phases differ by π."""
    setting = growing.setting
    scene, (crystal, waves) = setting.scene, setting.start()
    k = np.append(setting.wavevector(), 0.0)
    here, there = crystal.modes(k), crystal.modes(2 * k)
    snapshots, unit = [each.snapshots() for each in records], scene.sphere.time_scale
    one, other = (field(*each.stacks("displacement", "rotation")) for each in snapshots)
    tau, rest = snapshots[0].tau, snapshots[0].rest * scene.sphere.radius
    rest = rest - rest[scene.shape.centre_row * scene.shape.columns]
    wave = bloch(crystal, rest, (one - other) / 2, k) @ moving(here.duals[growing.branch])
    answer = bloch(crystal, rest, (one + other) / 2, 2 * k) @ moving(there.duals[growing.target])
    frequency, natural = here.frequencies[growing.branch] * unit, there.frequencies[growing.target] * unit
    amplitude = abs(fitted(tau, wave, [frequency, -frequency])[0])
    rate = abs(fitted(tau, answer, sums(waves, unit, frequency, natural), natural - 2 * frequency, natural)[-1])
    return float(rate * 2 * np.pi / frequency / amplitude**2 / scene.amplitude)


def field(moved: Floats, turned: Floats) -> Floats:
    """Return u_x, u_y and Rθ of all spheres (T, N, 3), in D0, from displacements (T, N, 2) and rotations (T, N)."""
    return np.concatenate([moved, turned[..., None]], axis=-1)


def moving(dual: Complexes) -> Complexes:
    """Return the components in the plane (3B,) of the dual of a mode."""
    return dual[:, list(PLANE)].ravel()


def bloch(crystal: Crystal, rest: Floats, motion: Floats, k: Floats) -> Complexes:
    """Return X (T, 3B), the amplitudes of the part Re[X e^{ik·r}] of the motion, for each of the B spheres of a cell.

    rest : (N, 2) places, relative to a sphere that is the first of its cell.
    """
    apart = rest[:, None] - crystal.position[None, :, :2]
    cells = apart @ np.linalg.pinv(crystal.vectors[:, :2])
    kinds = np.argmin(np.linalg.norm(cells - np.round(cells), axis=-1), axis=1)
    turned = motion * np.exp(-1j * rest @ k[:2])[:, None]
    return np.concatenate([2 * turned[:, kinds == each].mean(axis=1) for each in range(len(crystal))], axis=-1)


def sums(waves: Sequence[Wave], unit: float, frequency: float, natural: float) -> list[float]:
    """Return the frequencies of the waves of constant amplitude at 2k: sums of two at the start, and the branch's."""
    pairs = combinations_with_replacement([float(each.frequency) * unit for each in waves], 2)
    others = [one + other for one, other in pairs if abs(one + other - 2 * frequency) > 1e-6]
    return [*others, natural, -natural]


def fitted(
    tau: Floats, values: Complexes, constant: Sequence[float], detuning: float = 0.0, natural: float | None = None
) -> Complexes:
    """Return the amplitudes of waves e^{−iωτ}, followed by that of a growing wave e^{−iωτ} ∫₀^τ e^{iδs} ds."""
    basis = [np.exp(-1j * rate * tau) for rate in constant]
    if natural is not None:
        turned = np.exp(0.5j * detuning * tau) * np.sinc(detuning * tau / (2 * np.pi))
        basis.append(tau * turned * np.exp(-1j * natural * tau))
    return np.asarray(np.linalg.lstsq(np.stack(basis, axis=1), values)[0])


def pairs(records: Sequence[Record]) -> list[tuple[Record, Record]]:
    """Return the pairs of runs of opposite phases, the smaller phase first; ValueError for a run without a partner."""
    alike: dict[str, list[Record]] = {}
    for record in records:
        alike.setdefault(repr(all_but(record, "wave.phase", "name")), []).append(record)
    found = []
    for runs in alike.values():
        one, *others = sorted(runs, key=lambda each: each.scene.require_wave().phase)
        if (
            len(others) != 1
            or abs(others[0].scene.require_wave().phase - one.scene.require_wave().phase - np.pi) > 1e-9
        ):
            raise ValueError(f"{one.folder}: needs one partner whose wave.phase is larger by pi")
        found.append((one, others[0]))
    return found


def table(found: Sequence[tuple[Growing, float]]) -> str:
    """Return the growth of each resonance in theory and in LAMMPS."""
    lines = [f"{'density':>8}{'degrees':>8} {'branches':10}{'resonance':>11}{'run at':>11}{'theory':>9}{'LAMMPS':>9}"]
    for each, growth in found:
        scene = each.setting.scene
        density = scene.inclusion[0].density if scene.inclusion else scene.sphere.density
        lines.append(
            f"{density:8.1f}{scene.direction:8.1f} {f'{each.branch + 1} -> {each.target + 1}':10}{each.near:11.5f}"
            f"{scene.wavenumber:11.5f}{each.theory:9.4f}{growth:9.4f}{growth / each.theory:9.4f}"
        )
    return "\n".join([f"{lines[0]}{'ratio':>9}", *lines[1:]])


def draw(found: Sequence[tuple[Growing, float]]) -> Figure:
    """Return the figure for layers: growth over density in theory and in LAMMPS."""
    figure = page(3.8)
    axes = figure.subplots()
    layers = [(each, growth) for each, growth in found if each.setting.scene.inclusion]
    if layers:
        own = np.array([each.setting.scene.inclusion[0].density for each, _ in layers])
        densities = np.linspace(0.9 * own.min(), 1.04 * own.max(), 25)
        axes.plot(densities, layers[0][0].over(densities), color="black", label="second order, layers")
        axes.plot(own, [growth for _, growth in layers], "o", color="C1", label="LAMMPS")
    axes.axhline(UNIFORM, color="0.6", linestyle="--", label="uniform crystal, on its resonance")
    axes.set_ylim(0, 0.4)
    axes.set_xlabel("density of every second row (kg/m³)")
    axes.set_ylabel("growth a period ($D_0$ per $a$)")
    axes.legend(loc="center right")
    return figure


def measure(records: Sequence[Record]) -> list[tuple[Growing, float]]:
    """Return the resonance of each pair of runs, and its growth in the runs."""
    found = [(Growing.of(one.scene), (one, other)) for one, other in pairs(records)]
    return [(growing, measured(growing, both)) for growing, both in found]


main = script(__name__, measure, table, draw, ("runs", "runs of opposite phases, with snapshots"))
