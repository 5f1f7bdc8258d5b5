"""Dashpots in imperfect crystals, and compressed chains: runs against the network, and guards beside the truth."""

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.tools import compare
from granular_lmp import Record, Scene, run
from granular_lmp.effects.case import Case
from granular_lmp.effects.reading import Reading
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.outputs import CONTACTS
from granular_lmp.problem import prepare
from granular_lmp.runs.record import read_status
from granular_lmp.studies.combine import together
from granular_lmp.studies.features import KINDS, WAVES
from tests.conftest import members
from tests.hard.guard_study import Truth, compared, random_scene, truth

IMPERFECT = ("radii", "densities", "vacancies", "rows of another", "another sphere")
DAMPED = ("viscosity", "restitution")
SMALL = {"packing.rows": 18, "time.duration": 4.0, "time.sample": 1.0, "output.particles": 1.0, "wave.amplitude": 0.2}


def scene(*features: str, **more: Any) -> Scene:
    """Return a small crystal with features of the matrix."""
    return KINDS[0].scene.with_values(together(*(WAVES[name] for name in features)) | SMALL | more)


def without_step(given: Scene, folder: Path) -> Record:
    """Return three runs extrapolated to no step, free of the first and the second order that dashpots leave."""
    steps = (0.05, 0.025, 0.0125)
    coarse, middle, fine = (run(given.with_values({"time.timestep": h}), folder / str(h)) for h in steps)
    signals = {
        name: (8 * getattr(fine, name) - 6 * getattr(middle, name) + getattr(coarse, name)) / 3
        for name in ("p", "q", "phi")
    }
    return fine.with_signals(**signals)


PAIRS = [*product(DAMPED, IMPERFECT)]


# Each kind of imperfect crystal with one of the two dampings, in turn
@pytest.mark.parametrize(("damped", "imperfect"), members(PAIRS, *PAIRS[::2]))
def test_a_damped_imperfect_crystal_moves_as_its_network(damped: str, imperfect: str, tmp_path: Path) -> None:
    record = without_step(scene(damped, imperfect), tmp_path)
    result = compare.compare(record)
    assert result.theory == "network"
    # 3e-7 at most, measured: the third order of the step, in the second harmonic p
    assert all(error is not None and error < 1e-5 for error in result.error.values())
    declared = record.scene.effects
    wrong = {"effects.viscosity": 1.05 * declared.viscosity} if declared.viscosity else {"effects.restitution": 0.94}
    other = compare.compare(replace(record, scene=record.scene.with_values(wrong)))
    assert max(error for error in other.error.values() if error is not None) > 1e-4


@pytest.mark.parametrize("features", [("hertz",), ("restitution",), ("restitution", "radii")])
def test_a_compressed_chain_moves_along_its_line_as_its_network(features: tuple[str, ...], tmp_path: Path) -> None:
    record = without_step(scene("chain", *features), tmp_path)
    result = compare.compare(record, "network")
    assert result.error["p"] is not None
    assert result.error["p"] < 1e-6  # 1e-9, measured: no contact turns
    displacement, *_ = record.snapshots().stacks("displacement")
    assert not displacement[..., 0].any()
    assert displacement[..., 1].any()


# --- guards ----------------------------------------------------------------------------------------------------------

# Of the random scenes: a contact slides at the whole force of Hertz, nothing happens where strong dashpots leave the
# bound undecided, contacts open where the bound has not decided before, nothing happens and forces alone look weaker
SLIDES, WARY, OPENS, WEAKER = 2, 3, 9, 42


@pytest.mark.parametrize("number", members([SLIDES, WARY, OPENS, WEAKER], WEAKER))
def test_guards_with_dashpots_miss_nothing_and_stop_no_valid_run(number: int, tmp_path: Path) -> None:
    openings, slip = compared(random_scene("damped", number), tmp_path / "run")
    assert (openings.happened, slip.happened) == (number == OPENS, number == SLIDES)
    for each in (openings, slip):
        assert not each.missed, each
        assert not each.stopped, each
        assert abs(each.late) <= 0.2, each


def test_the_smallest_overlap_is_never_above_the_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    true: list[float] = []

    def remembered(deck: Deck, folder: Path) -> Truth:
        found = truth(deck, folder)
        true.append(float(found.overlap.min()))
        return found

    monkeypatch.setattr("tests.hard.guard_study.truth", remembered)
    said = []
    for name in ("bound", "force"):
        compared(random_scene("damped", WEAKER), tmp_path / name)
        said.append(read_status(tmp_path / name)["smallest_overlap"])
        monkeypatch.setattr(Case, "strongest_dashpot", 0.0)
    assert said[0] < true[0] < said[1] - 0.01  # 0.198; the forces of the contacts alone say 0.215


def test_the_strongest_dashpot_bounds_that_of_every_contact() -> None:
    heavy = scene("restitution", inclusion=[{"share": 0.2, "density": 22000.0, "youngs_modulus": 210e9}])
    case = Case(prepare(heavy).scene)
    contacts, sphere = case.contacts, heavy.sphere
    share = -np.log(0.95) / np.hypot(np.pi, np.log(0.95))
    mass = 1 / (1 / contacts.mass[contacts.i] + 1 / contacts.mass[contacts.j])
    coefficient = contacts.normal_stiffness / (1.5 * np.sqrt(contacts.overlap))
    # √5 ζ √(m A) δ^{1/4} of every contact when it bears the force at rest of the lattice
    overlap = (sphere.holding_force / coefficient) ** (2 / 3)
    dashpots = np.sqrt(5 * mass * coefficient) * share * overlap**0.25
    assert dashpots.max() > 1.5 * dashpots.min()
    assert dashpots.max() <= case.strongest_dashpot * (1 + 1e-9) <= 1.5 * dashpots.max()


def test_hertz_contacts_slide_at_the_whole_force_in_a_perfect_crystal_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    strong = {"effects.restitution": 0.6, "effects.sliding": False, "effects.friction": 1.5, "wave.amplitude": 0.5}
    pulled = scene("hertz", **(strong | {"wave.mode": "L", "wave.wavenumber": 2.0 * np.pi / 3, "time.timestep": 0.05}))
    _, slip = compared(pulled, tmp_path / "whole")
    assert slip.happened
    assert slip.said
    assert slip.late <= 0.2
    # By their springs alone none would slide: dashpots pull before the contacts open
    of = Reading.of
    monkeypatch.setattr(Reading, "of", lambda each: replace(of(each), whole=False))
    assert compared(pulled, tmp_path / "springs")[1].missed


def test_a_bound_that_does_not_decide_leaves_it_to_the_contacts(tmp_path: Path) -> None:
    strong = {"effects.viscosity": 1e-6, "wave.amplitude": 0.5, "effects.friction": 20.0, "effects.sliding": False}
    given = scene("radii", **strong)
    record = run(given, tmp_path / "closed")
    found = record.info["guards"]["open_contacts"]
    assert found["quiet"]
    assert record.info["smallest_overlap"] < 0.01  # the bound, below what counts as open
    assert not (tmp_path / "closed" / CONTACTS).exists()
