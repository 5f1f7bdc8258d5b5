"""The errors on the page that says which tool to take: of runs of LAMMPS to a tolerance, and of the formulas."""

import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.measure import signals
from granular_analysis.theory.choice import trajectory, wave_of
from granular_analysis.theory.lattice import torus
from granular_lmp.accuracy.tolerance import run
from granular_lmp.lammps.outputs import PER_SAMPLE
from tests.compare.test_compare import from_theory
from tests.conftest import PAPER, members

PAGE = (Path(__file__).parents[2] / "docs" / "which-tool.md").read_text(encoding="utf-8")
STRIP = PAPER.with_values({"packing.rows": "auto"})


def cost_rows() -> dict[float, list[str]]:
    """Return the other cells of each row of the table of costs by the accuracy wanted."""
    lines = [line.strip("| ").split(" | ") for line in PAGE.splitlines() if re.match(r"\| 1e-\d \|", line)]
    return {float(line[0]): line[1:] for line in lines}


@pytest.mark.parametrize("wanted", members([1e-1, 1e-2, 1e-3, 1e-4, 1e-5], 1e-5, 1e-4, 1e-3))
def test_the_costs_on_the_page_are_of_these_runs(wanted: float, tmp_path: Path) -> None:
    setting, steps, work, shown, *_ = cost_rows()[wanted]
    scene = STRIP.with_values({"time.tolerance": wanted})
    assert float(setting.strip("`").removeprefix("time.tolerance = ")) == wanted
    record = run(scene, tmp_path / "run")
    if steps != "the same":
        taken = {
            round(float(folder.name.removesuffix(PER_SAMPLE))) for folder in (tmp_path / "run").glob(f"*{PER_SAMPLE}")
        }
        assert {round(scene.time.sample / Fraction(step)) for step in steps.split(" + ")} == taken
    assert work == f"{scene.shape.spheres} × {record.info['steps']}"
    assert all(float(error) <= wanted for error in shown.split(", "))
    found = signals.errors(record, trajectory("exact-lattice", wave_of(record), record.tau))
    # Two digits are printed, half a unit of the second is at most 5 %
    assert [float(error) for error in shown.split(", ")] == pytest.approx([found["p"], found["q"]], rel=0.05)


def test_the_formulas_are_as_good_as_the_page_says() -> None:
    record = from_theory(PAPER, "exact-lattice", np.arange(0.0, 120.5, 0.5))
    wave = wave_of(record)
    for theory in ("second-order", "three-mode"):
        (line,) = [line for line in PAGE.splitlines() if f"`{theory}` |" in line]
        shown = [float(word) for word in re.findall(r"\d\.\de-\d\d", line)]
        found = signals.errors(record, trajectory(theory, wave, record.tau))
        assert shown == pytest.approx(list(found.values()), rel=0.05), theory  # two digits


@pytest.mark.parametrize(("rtol", "shown"), [(1e-6, "5.6e-04 with rtol 1e-6"), (1e-10, "2.3e-08 with 1e-10")])
def test_the_exact_lattice_is_as_good_as_the_page_says(rtol: float, shown: str) -> None:
    assert shown in PAGE
    wave, tau = wave_of(from_theory(PAPER, "exact-lattice", np.arange(2.0))), np.arange(0.0, 120.5, 0.5)
    p, exact = (torus(wave, tau, rtol=each)[0] for each in (rtol, 1e-12))
    assert np.linalg.norm(p - exact) / np.linalg.norm(exact) < 1.5 * float(shown.split()[0])
