"""The figure and the table of what accuracy costs: fronts, recommendations, and theories that can be wrong."""

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.accuracy import case as accuracy
from cases.accuracy.case import (
    FORMULA,
    LAMMPS,
    LATTICE,
    TOLERANCE,
    Setting,
    Study,
    front,
    models,
    recommended,
)
from granular_analysis.measure import signals
from granular_analysis.theory.choice import trajectory, wave_of
from granular_lmp import Record
from granular_lmp.accuracy.tolerance import run
from tests.compare.test_compare import from_theory
from tests.conftest import PAPER, members
from tests.stand_in import leave_folder

TAU = np.arange(0.0, 10.0, 0.5)


def setting(seconds: float, error: float, family: str = "time step", name: str = "") -> Setting:
    return Setting(family, name, seconds, seconds, seconds, {"p": error, "q": error / 10, "phi": None})


@pytest.fixture(scope="module")
def study() -> Study:
    """A study whose runs are made up and whose reference is the exact lattice."""
    record = from_theory(PAPER, "exact-lattice", TAU)
    settings = [
        setting(0.1, 1e-2, name="0.1"),
        setting(0.4, 1e-3, name="0.05"),
        setting(0.2, 5e-5, TOLERANCE, "1e-03"),
        setting(0.15, 9e-4, TOLERANCE, "1e-02"),
        setting(20.0, 1.0, "strip or sheet", "sheet"),
    ]
    return Study(settings, setting(9.0, 1e-8, "reference"), record)


def test_the_front_is_what_nothing_else_beats(study: Study) -> None:
    assert [s.seconds for s in front(study.settings)] == [0.1, 0.15, 0.2]
    beaten = [*study.settings, setting(0.09, 1e-6)]
    assert [s.seconds for s in front(beaten)] == [0.09]
    hardly = [setting(1.0, 1e-3), setting(2.0, 0.95e-3), setting(3.0, 0.8e-3)]  # a twentieth, a fifth
    assert [s.seconds for s in front(hardly)] == [1.0, 3.0]


def test_a_component_that_is_not_there_is_no_accuracy(study: Study) -> None:
    untracked = replace(study.settings[0], seconds=1e-3, error={"p": 1e-9, "q": None, "phi": None})
    with_it = replace(study, settings=[*study.settings, untracked])
    assert untracked not in with_it.complete
    assert front([untracked], "q") == []


def test_a_tolerance_is_recommended_if_it_keeps_its_word(study: Study) -> None:
    assert recommended(study) is study.settings[2]
    broken = [replace(s, error=s.error | {"p": 2e-3}) if s.family == TOLERANCE else s for s in study.settings]
    assert recommended(replace(study, settings=broken)) is None


def test_the_level_of_model_is_measured_against_the_exact_lattice(study: Study) -> None:
    levels = {(s.family, s.name): s for s in models(study, repeats=1)}
    lattice = [s.worst for (family, _), s in levels.items() if family == LATTICE]
    assert lattice[-1] < 1e-6 < lattice[0]  # rtol 1e-10; 1e-2
    # Second order leaves a² out: a few per mille of p at a = 0.2, TR
    assert 1e-4 < levels[FORMULA, "second-order"].worst < 1e-2
    assert levels[LAMMPS, ""].worst < 1e-7  # here it is the exact lattice, integrated with rtol = 1e-10
    wrong = study.record.with_signals(p=1.01 * study.record.p)
    (off,) = [s for s in models(replace(study, record=wrong), repeats=1) if s.family == LAMMPS]
    assert off.error["p"] == pytest.approx(0.01, rel=1e-4)


def test_what_slides_has_no_theory(study: Study) -> None:
    for name in ("sliding", "rolling"):
        record = replace(study.record, info={"effects": {name: {"on": True, "called_for": True}}})
        assert models(replace(study, record=record)) == []
        assert accuracy.unheld(record) == [f"effects.{name}"]
    assert accuracy.unheld(study.record) == []


# --- the folder ---


def content(study: Study) -> dict[str, Any]:
    """``cost.json`` of a study."""

    def row(s: Setting) -> dict[str, Any]:
        times = {"seconds": s.seconds, "seconds_min": s.fastest, "seconds_max": s.slowest}
        errors = {f"error_{name}": value for name, value in s.error.items()}
        return {"varied": s.family, "setting": s.name, "repeats": 1} | times | errors

    points = [*map(row, study.settings), {"repeats": 0}]
    return {"reference": row(study.reference) | {"runs": ["coarse", "fine"], "order": 2}, "points": points}


def written(study: Study, folder: Path, record: Record) -> None:
    for name, step in (("coarse", 0.1), ("fine", 0.05)):
        leave_folder(replace(record, scene=record.scene.with_values({"time.timestep": step})), folder / name)
    (folder / "cost.json").write_text(json.dumps(content(study)))


@pytest.mark.usefixtures("drawn_once")
def test_a_study_is_read_and_drawn(
    study: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(accuracy, "models", partial(models, repeats=1))
    written(study, tmp_path, study.record)
    loaded = Study.load(tmp_path)
    assert (loaded.settings, loaded.reference) == (study.settings, study.reference)
    assert accuracy.main([str(tmp_path), "-o", str(tmp_path / "a.png")]) == 0
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    printed = capsys.readouterr().out
    assert f"\n{LAMMPS}  " in printed


@pytest.mark.parametrize("text", ["{", '{"reference": null, "points": []}', "[]"])
def test_what_is_no_study_is_refused_in_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "cost.json").write_text(text)
    with pytest.raises(SystemExit, match=r"cost.json: not the result of a finished granular-lmp cost"):
        accuracy.main([str(tmp_path)])


# --- docs/which-tool.md ---

PAGE = (Path(__file__).parents[2] / "docs" / "which-tool.md").read_text(encoding="utf-8")
STRIP = PAPER.with_values({"packing.rows": "auto"})


def cost_rows() -> dict[float, list[str]]:
    """Return the other cells of each row of the table of costs by the tolerance."""
    lines = [line.strip("| ").split(" | ") for line in PAGE.splitlines() if re.match(r"\| 1e-\d \|", line)]
    return {float(line[0]): line[1:] for line in lines}


@pytest.mark.parametrize("wanted", members([1e-1, 1e-2, 1e-3, 1e-4, 1e-5], 1e-5, 1e-4, 1e-3))
def test_the_costs_on_the_page_are_of_these_runs(wanted: float, tmp_path: Path) -> None:
    work, shown, *_ = cost_rows()[wanted]
    scene = STRIP.with_values({"time.tolerance": wanted})
    record = run(scene, tmp_path / "run")
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
