"""The reference of a run: which one is taken, what the network holds and refuses, and that it is the run's own."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure import reference
from granular_analysis.measure.reference import Reference
from granular_analysis.theory import catalogue
from granular_analysis.theory.choice import refuse_less, wave_of
from granular_analysis.theory.errors import TheoryError
from granular_analysis.tools import compare
from granular_lmp import Record, Scene, run
from tests.beside_network import extrapolated
from tests.stand_in import of_first_format

SMALL = Scene.load("tr_periodic").with_values(
    {"packing.rows": 8, "packing.columns": 6, "wave.amplitude": 0.05}
    | {"time.duration": 4.0, "time.sample": 1.0, "output.particles": 1.0}
)
OVERLAP_RATIO = SMALL.sphere.overlap_ratio
SIGNALS = 1e-5  # relative, of the recorded signals: the time step leaves less than 4e-6
VACANCY = {"inclusion": [{"spheres": [[5, 2]], "vacancy": True}]}


@pytest.fixture(scope="module")
def imperfect(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """A run of a small crystal with a vacancy."""
    return run(SMALL.with_values(VACANCY), tmp_path_factory.mktemp("imperfect") / "run")


def test_a_perfect_run_is_left_to_a_theory_unless_the_network_is_asked_for(tmp_path: Path) -> None:
    record = run(SMALL, tmp_path / "run")
    assert compare.compare(record).theory == "hierarchy"
    network, exact = (compare.compare(record, name) for name in ("network", "exact-lattice"))
    assert network.theory == "network"
    assert network.signals is not None
    assert exact.signals is not None
    # Both leave 1e-9 of a motion of D0
    np.testing.assert_allclose(network.signals, exact.signals, rtol=0, atol=1e-7)
    assert not np.allclose(network.signals, 1.001 * np.array(exact.signals), rtol=0, atol=1e-7)


@pytest.mark.usefixtures("unrendered")
def test_compare_takes_the_network_of_an_imperfect_run_and_says_so(
    imperfect: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imperfect.folder is not None
    assert compare.main([str(imperfect.folder), "--json", str(tmp_path / "out.json")]) == 0
    out = capsys.readouterr().out
    assert "no theory of a plane wave holds inclusion.spheres, inclusion.vacancy" in out
    assert "the run is compared with the network of its spheres" in out
    (entry,) = json.loads((tmp_path / "out.json").read_text())
    assert (entry["theory"], entry["lattice_error"], entry["budget"]) == ("network", {}, [])
    assert "signals" not in entry
    # The time step leaves 1e-4 of a second harmonic
    assert 0 < max(entry["error"].values()) < 1e-3
    assert (imperfect.folder / "compare.png").is_file()
    wrong = compare.compare(imperfect.with_signals(q=1.01 * imperfect.q)).error["q"]
    assert wrong == pytest.approx(0.01, rel=1e-2)


def test_the_network_refuses_materials_that_no_sphere_has(tmp_path: Path) -> None:
    stiff, soft, others = (
        {"rows": rows, "youngs_modulus": E} for rows, E in (([2, 3], 9e10), ([2, 3], 6e10), ([5, 5], 8e10))
    )
    record = run(SMALL.with_values({"inclusion": [soft, others]}), tmp_path / "run")
    assert max(compare.compare(record, "network").error.values()) < 1e-3  # the time step leaves less
    replaced = run(SMALL.with_values({"inclusion": [stiff, soft, others]}), tmp_path / "replaced")
    with pytest.raises(TheoryError, match="inclusion: the scene declares 4 materials, .*, and spheres have 3"):
        compare.compare(replaced, "network")


def test_the_figure_draws_what_was_compared(imperfect: Record) -> None:
    result = compare.compare(imperfect)
    lines = compare.figure(imperfect, result).axes[0].get_lines()
    assert [line.get_label() for line in lines] == ["LAMMPS", "network"]
    assert result.signals is not None
    assert np.array_equal(lines[1].get_ydata(), result.signals[0])


def test_without_snapshots_an_imperfect_run_is_compared_with_nothing(tmp_path: Path) -> None:
    record = run(SMALL.with_values(VACANCY | {"output.particles": 0.0}), tmp_path / "run")
    result = compare.compare(record)
    assert (result.theory, result.error, result.signals) == (None, {}, None)
    assert "run its scene with output.particles" in result.notes[-1]
    with pytest.raises(TheoryError, match="theory = 'network': .*run its scene with output.particles"):
        compare.compare(record, "network")
    with pytest.raises(TheoryError, match="theory = None: .* is compared with nothing"):
        compare.figure(record, result)


def test_a_long_run_is_left_until_the_network_is_asked_for(imperfect: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference, "MOST_UNASKED", 100.0)
    (note,) = compare.compare(imperfect).notes
    assert "48 spheres until tau = 4 exceed 100 spheres times tau" in note
    assert "use --theory network" in note
    assert compare.compare(imperfect, "network").error["q"] is not None


def test_a_first_snapshot_that_cannot_be_read_is_a_reason(imperfect: Record, tmp_path: Path) -> None:
    untracked = run(SMALL.with_values(VACANCY | {"effects.tracking": False}), tmp_path / "untracked")
    assert "has no column v_theta" in compare.compare(untracked).notes[-1]
    assert untracked.folder is not None
    of_first_format(untracked.folder)  # no digest protects its files
    (untracked.folder / "dump.particles").write_text((imperfect.folder / "dump.particles").read_text())
    for text in ("", "ITEM: TIMESTEP\n"):
        (untracked.folder / "dump.centre").write_text(text)
        with pytest.raises(TheoryError, match="dump.centre: is no text dump"):
            compare.compare(untracked, "network")
    assert imperfect.folder is not None
    head = (imperfect.folder / "dump.centre").read_text().splitlines(keepends=True)[:9]
    (untracked.folder / "dump.centre").write_text("".join(head))
    assert "dump.centre: is no text dump" in compare.compare(untracked).notes[-1]
    snapshots = untracked.folder / "dump.particles"
    snapshots.write_text(snapshots.read_text().replace("\n1 1 ", "\n1 1 e", 1))
    assert "dump.particles: is no text dump" in compare.compare(untracked).notes[-1]


# --- what the network holds ---

HELD_BY_THE_NETWORK: dict[str, dict[str, Any]] = {
    "standing": {"wave.form": "standing"},
    "oblique": {"wave.direction": 60.0, "wave.wavenumber": 0.9},
    "packet": {"packing.rows": 40, "envelope.length": 5.2, "time.duration": 3.0},
    "held": {"packing.rows": 17, "packing.ends": "fixed", "time.allow_echo": True},
    "compressed": {"packing.contact_force": 1e-7, "disorder.density": 0.1},
    "RT": {"wave.mode": "RT", "disorder.density": 0.1},
    "micro": {"sphere.radius": 1e-4, "disorder.density": 0.1},
    "si": {"sphere.radius": 5e-3, "packing.contact_force": 1.0, "sphere.work_of_adhesion": 0.0} | VACANCY,
}


@pytest.mark.parametrize("case", HELD_BY_THE_NETWORK)
def test_the_network_holds_a_run(case: str, tmp_path: Path) -> None:
    scene = SMALL.with_values({"wave.amplitude": 0.2} | HELD_BY_THE_NETWORK[case])
    pair = extrapolated(scene, tmp_path)
    result = compare.compare(pair.record, "network")
    assert all(error is None or error < SIGNALS for error in result.error.values())


DRIVEN = {
    "packing.ends": "fixed",
    "packing.rows": 13,
    "wave.form": "driven",
    "envelope.ramp": 5.0,
    "time.allow_echo": True,
}
SHAKEN = {"source": [{"rows": [4, 4], "motion": "x", "amplitude": 0.1, "ramp": 2.0}]}
FEW = {"packing.rows": 5, "packing.columns": 5, "striker.1.spheres": [[0, 2]]}
MOVED = {
    "along y by the branch of a film": ("multilayer", DRIVEN | {"packing.layers": 2}),
    "along x by the branch of a layer": ("monolayer_rocking", DRIVEN | {"wave.mode": "H1"}),
    "a row of all layers": ("fcc_transverse", SHAKEN),
    "noise beside a striker": ("point_impact", FEW | {"start.noise": 0.5}),
    "noise alone": ("solitary_chain", {"packing.rows": 5, "striker": [], "start.noise": 0.5}),
}


@pytest.mark.parametrize("case", MOVED)
def test_the_network_has_what_moves_the_run_in_its_units(case: str, tmp_path: Path) -> None:
    name, changes = MOVED[case]
    record = run(Scene.load(name).with_values(changes | {"time.duration": 6.0}), tmp_path / "run")
    errors = [error for error in compare.compare(record, "network").error.values() if error is not None]
    assert 0 < max(errors) < 0.02  # the time step leaves that of a motion that has just begun


def test_the_incremental_law_is_held_and_is_not_the_secant_one(tmp_path: Path) -> None:
    scene = SMALL.with_values({"effects.shear_law": "incremental", "disorder.radius": 0.3 * OVERLAP_RATIO})
    # LAMMPS adds to the shear force in first order of the step, which the pair does not see: 4e-6 of p is left
    pair = extrapolated(scene, tmp_path, (0.00625, 0.003125))
    assert all(error is not None and error < SIGNALS for error in compare.compare(pair.record).error.values())
    secant = replace(pair.record, scene=scene.with_values({"effects.shear_law": "secant"}))
    assert compare.compare(secant).error["p"] > 10 * SIGNALS


def test_contacts_that_slide_have_the_friction_of_the_run_and_cost_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slippery = {"effects.sliding": True, "effects.friction": 0.03, "wave.amplitude": 0.2, "time.duration": 2.0}
    record = run(SMALL.with_values(VACANCY | slippery | {"time.timestep": 0.0125}), tmp_path / "run")
    result = compare.compare(record)
    # A single run with the step 0.0125 leaves some 1e-5
    assert all(error is not None and error < 1e-4 for error in result.error.values())
    rough = compare.compare(replace(record, scene=record.scene.with_values({"effects.friction": 0.04})))
    assert rough.error["p"] > 1e-3
    monkeypatch.setattr(reference, "MOST_UNASKED", 48 * 2.0 * 39)  # each sphere costs as forty
    assert "48 spheres until tau = 2 exceed 94 spheres times tau" in compare.compare(record).notes[-1]


def test_a_run_to_a_tolerance_meets_it_against_the_network(tmp_path: Path) -> None:
    record = run(SMALL.with_values(VACANCY | {"time.tolerance": 1e-4}), tmp_path / "run")
    result = compare.compare(record)
    assert result.theory == "network"
    assert all(error is not None and error < 1e-4 for error in result.error.values())


def test_the_network_refuses_by_name_what_it_leaves_out() -> None:
    tau = np.arange(3.0)
    info = {"effects": {name: {"on": True} for name in ("shear", "rotation", "rolling")}}
    record = Record.of_centre(tau, tau, tau, tau, SMALL.with_values({"time.allow_echo": True}), info)
    with pytest.raises(TheoryError, match="no theory here holds effects.rolling"):
        compare.compare(record, "network")
    with pytest.raises(TheoryError, match="theory = 'network' leaves out effects.rolling; theories that hold it: none"):
        refuse_less("network", frozenset({"effects.rolling", "striker"}))


def test_all_that_stands_against_the_network_is_said_at_once() -> None:
    scene = SMALL.with_values({"wave.form": "standing"})
    tau = np.array([0.0, 1e6])
    record = Record.of_centre(tau, tau, tau, tau, scene, {})
    reason = Reference.of(record, wave_of(record)).reason
    assert "has no snapshots, and " in reason
    assert "exceed 1000000 spheres times tau" in reason


def test_what_the_network_lacks_is_the_reason_why_nothing_is_compared(
    imperfect: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    wave = wave_of(imperfect)
    monkeypatch.setitem(catalogue.HOLDS, "network", catalogue.HOLDS["network"] - {"inclusion.vacancy"})
    result = Reference.of(imperfect, wave)
    assert (result.name, result.reason) == (None, "the network leaves out inclusion.vacancy")
