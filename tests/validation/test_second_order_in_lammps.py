"""Second order of any crystal beside LAMMPS: lattices, laws, compression, layers, directions and forms of the start."""

from collections.abc import Callable
from functools import cache
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.network import Material, Network
from granular_analysis.theory.scenes import Setting
from granular_analysis.theory.second_order import second_order, wave
from granular_lmp import Record, Scene, run
from tests.by_commands import moved, padded
from tests.conftest import members
from tests.manual import Measure, Mutant, verifies

LAYERS = [{"rows": [0, 23], "every": 2, "density": 4400.0}]
COLUMNS = {"packing.rows": 24, "packing.columns": 3}
SHORT = {"packing.rows": 8, "wave.wavenumber": pi / 4, "output.particles": 0.0}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "secant": ("tr_periodic", COLUMNS),
    "incremental": ("tr_periodic", COLUMNS | {"effects.shear_law": "incremental"}),
    "jkr": ("tr_periodic", COLUMNS | {"sphere.adhesion_law": "jkr"}),
    "square": ("tr_square", {"wave.mode": "L"}),
    "chain": ("l_chain", {"packing.rows": 16, "packing.ends": "periodic"}),
    "compressed": ("steel_compressed", COLUMNS),
    "oblique": ("tr_oblique", {}),
    "standing": ("tr_grating", {"packing.rows": 20}),
    "layers": ("tr_periodic", COLUMNS | {"inclusion": LAYERS}),
    "layer on a substrate, S1": ("monolayer_rocking", SHORT),
    "layer on a substrate, S2": ("monolayer_vertical", SHORT),
    "fcc": ("fcc_transverse", {"output.particles": 0.0}),
    "hcp": ("hcp_c_axis", {"output.particles": 0.0}),
    "four layers": ("multilayer", {"output.particles": 0.0}),
    "layers, upper branch": ("tr_periodic", COLUMNS | {"inclusion": LAYERS, "wave.mode": "RT"}),
}


def extrapolated(scene: Scene, folder: Path, amplitude: float) -> tuple[Record, np.ndarray]:
    """Return a record, and p, q, φ (3, T) of even order in the amplitude, with the step extrapolated to 0.

    Phases 0 and π give ±a; without odd orders the next after the second is the fourth. LAMMPS turns a slip by the end
    of a step, and loads it with the stiffness there under the incremental law: errors of first and second order go.
    """
    steps = (0.1, 1 / 3), (0.05, -2.0), (0.025, 8 / 3)
    weights = {(step, phase): weight / 2 for step, weight in steps for phase in (0.0, pi)}
    total = np.zeros(3)[:, None]
    for (step, phase), weight in weights.items():
        values = {"wave.amplitude": amplitude, "time.duration": 10.0, "time.timestep": step, "time.sample": 0.5}
        phase += 0.3  # at which what the start leaves in the contacts is not 0
        record = run(scene.with_values(values | {"wave.phase": phase}), folder / f"{step} {phase:.1f} {amplitude}")
        total = total + weight * np.nan_to_num([record.p, record.q, record.phi])
    return record, total


def left(record: Record, even: np.ndarray) -> float:
    """Return the share of the second order that theory and LAMMPS do not have in common."""
    theory = np.array(Setting(record.scene).signals(record.tau)[1])
    return float(np.linalg.norm(even - theory) / np.linalg.norm(theory))


@pytest.fixture(scope="module")
def even(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Record, np.ndarray]]:
    """Runs of the cases at a = 0.02, each made once, as `extrapolated` returns them."""

    @cache
    def make(name: str) -> tuple[Record, np.ndarray]:
        shipped, values = CASES[name]
        return extrapolated(Scene.load(shipped).with_values(values), tmp_path_factory.mktemp("even"), 0.02)

    return make


# The upper branch of layers, the second of a layer on a substrate and a film have their likes beside them; fcc and hcp
# stand in test_space_in_lammps. The square lattice stands below, and of the secant law are all whose law is not named
MORE = "layers, upper branch", "layer on a substrate, S2", "fcc", "hcp", "four layers", "square", "secant"


@pytest.mark.parametrize("name", members(CASES, *MORE))
@verifies(
    "Second order in LAMMPS: square, chain, compressed, JKR, incremental, oblique, layered, space",
    reference="analytic: second order of any crystal, a = 0.02",
    tolerance=0.0002,
    reason="fourth order is some tenths of a² = 4e-4 of the second",
    mutant=Mutant(
        "analysis/granular_analysis/theory/bonds.py",
        "return Law(f, f1 / d1, bent / d1**3, third",
        "return Law(f, f1 / d1, 1.01 * bent / d1**3, third",
    ),
)
def test_lammps_has_the_second_order(
    name: str, even: Callable[[str], tuple[Record, np.ndarray]], measured: Measure
) -> None:
    # Fourth order is some tenths of a² = 4e-4 of the second, and LAMMPS's rounding, 1e-11 nm of 5e-3 nm, 1e-6 of it
    measured(left(*even(name)))


def test_what_is_left_falls_as_the_square_of_the_amplitude(tmp_path: Path) -> None:
    scene = Scene.load("tr_square").with_values({"wave.mode": "L"})
    strong, weak = (left(*extrapolated(scene, tmp_path, amplitude)) for amplitude in (0.16, 0.08))
    assert np.log2(strong / weak) == pytest.approx(2, abs=0.1)


def test_another_density_is_seen(even: Callable[[str], tuple[Record, np.ndarray]]) -> None:
    record, found = even("layers")
    other = record.scene.with_values({"inclusion": [LAYERS[0] | {"density": 4300.0}]})
    theory = np.array(Setting(other).signals(record.tau)[1])
    assert np.linalg.norm(found - theory) > 1e-2 * np.linalg.norm(theory)


def test_what_is_no_pattern_of_rows_is_refused() -> None:
    scene = Scene.load("tr_periodic").with_values(COLUMNS)
    for inclusion, words in (
        ({"rows": [0, 23], "every": 2, "radius": 5.01e-7}, "inclusion 1 has radius; allowed: rows, every, density"),
        ({"spheres": [[3, 1]], "density": 4400.0}, "inclusion 1 has spheres"),
    ):
        with pytest.raises(ValueError, match=words):
            Setting(scene.with_values({"inclusion": [inclusion]})).crystal()
    walls = scene.with_values({"packing.ends": "fixed", "packing.rows": 25, "time.duration": 2.0})
    with pytest.raises(ValueError, match="do not repeat"):
        Setting(walls.with_values({"inclusion": [{"rows": [11, 13], "density": 4400.0}]})).crystal()


# --- a lattice that no scene has, as commands -------------------------------------------------------------------------

SILICA = Scene.load("tr_periodic").sphere
NANOMETRE = 1e-9
MATERIAL = Material(SILICA.youngs_modulus / 1e6, SILICA.poisson_ratio, SILICA.work_of_adhesion * 1e3)


def honeycomb() -> tuple[Crystal, np.ndarray, np.ndarray]:
    """Return the crystal of honeycomb in nm, ag, ns; and the places (N, 2) and the box (2,) of 4 × 3 of its cells."""
    a, radius = SILICA.lattice_constant / NANOMETRE, SILICA.radius / NANOMETRE
    cell = a * np.array([np.sqrt(3), 3.0])
    basis = a * np.array([[0, 0], [np.sqrt(3) / 2, 0.5], [np.sqrt(3) / 2, 1.5], [0, 2]])
    crystal = Crystal.of(np.diag(cell), basis, radius, SILICA.density * 1e-6, [MATERIAL])
    shifts = cell * np.array([[i, j] for i in range(4) for j in range(3)])
    return crystal, (shifts[:, None] + basis).reshape(-1, 2), cell * [4, 3]


def test_lammps_has_the_second_order_of_honeycomb() -> None:
    crystal, place, box = honeycomb()
    k = 2 * pi * np.array([1 / box[0], 1 / box[1]])
    one = wave(crystal, k, 2)
    size, sample = 0.02 * SILICA.static_overlap / NANOMETRE, 0.6
    cells = len(place) // len(crystal)
    field = size * np.tile(one.shape, (cells, 1)) * np.exp(1j * (place @ k) + 0.3j)[:, None]
    radius, alike = SILICA.radius / NANOMETRE, np.ones(len(place))
    spheres = Network(place, radius * alike, SILICA.density * 1e-6 * alike, (MATERIAL,), cell=tuple(box))
    begin, rate = (
        np.array([padded(part[:, :2], 0, 1), padded(part[:, 5:], 2) / radius])
        for part in (field.real, one.frequency * field.imag)
    )
    # μ: a few times what the wave needs; more would keep LAMMPS from turning the slip with its contact
    law = "* * dmt 73e3 0.0 0.17 31.5 tangential mindlin NULL 0.0 0.5 damping velocity"
    even = np.zeros(1)
    for count, weight in ((1, 1 / 3), (2, -2.0), (4, 8 / 3)):
        for sign in (1, -1):
            seen = moved(spheres, law, sign * begin, sign * rate, sample / 64 / count, 64 * count, 20)
            even = even + weight / 2 * seen[..., :2]
    start = size * np.exp(0.3j)
    theory = second_order(crystal, [one.times(start)], sample * np.arange(21), place[:: len(crystal)])[1]
    expected = np.concatenate(theory, axis=1)[..., :2]
    # LAMMPS rounds places of 3000 nm to 5e-13 nm, 1e-8 of u and 1e-5 of its second order, at each step
    assert np.linalg.norm(even - expected) < 1e-3 * np.linalg.norm(expected)
