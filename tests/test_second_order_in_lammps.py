"""Second order of any crystal beside LAMMPS: lattices, laws, compression, layers, directions and forms of the start."""

from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.theory.scenes import Setting
from granular_lmp import Record, Scene, run

LAYERS = [{"rows": [0, 23], "every": 2, "density": 4400.0}]
COLUMNS = {"packing.rows": 24, "packing.columns": 3}
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
        values = {"wave.amplitude": amplitude, "time.duration": 16.0, "time.timestep": step, "time.sample": 0.5}
        phase += 0.3  # at which what the start leaves in the contacts is not 0
        record = run(scene.with_values(values | {"wave.phase": phase}), folder / f"{step} {phase:.1f} {amplitude}")
        total = total + weight * np.nan_to_num([record.p, record.q, record.phi])
    return record, total


def left(scene: Scene, folder: Path, amplitude: float) -> float:
    """Return the share of the second order that theory and LAMMPS do not have in common."""
    record, even = extrapolated(scene, folder, amplitude)
    theory = np.array(Setting(record.scene).signals(record.tau)[1])
    return float(np.linalg.norm(even - theory) / np.linalg.norm(theory))


@pytest.mark.parametrize("name", CASES)
def test_lammps_has_the_second_order(name: str, tmp_path: Path) -> None:
    shipped, values = CASES[name]
    # Fourth order is some tenths of a² = 4e-4 of the second, and LAMMPS's rounding, 1e-11 nm of 5e-3 nm, 1e-6 of it
    assert left(Scene.load(shipped).with_values(values), tmp_path, 0.02) < 2e-4


def test_what_is_left_falls_as_the_square_of_the_amplitude(tmp_path: Path) -> None:
    scene = Scene.load("tr_square").with_values({"wave.mode": "L"})
    strong, weak = (left(scene, tmp_path, amplitude) for amplitude in (0.16, 0.08))
    assert np.log2(strong / weak) == pytest.approx(2, abs=0.1)


def test_another_density_is_seen(tmp_path: Path) -> None:
    shipped, values = CASES["layers"]
    record, even = extrapolated(Scene.load(shipped).with_values(values), tmp_path, 0.02)
    other = record.scene.with_values({"inclusion": [LAYERS[0] | {"density": 4300.0}]})
    theory = np.array(Setting(other).signals(record.tau)[1])
    assert np.linalg.norm(even - theory) > 1e-2 * np.linalg.norm(theory)


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
