"""The coherent second harmonic: theory, network and LAMMPS give the same one, in crystals that are perfect and not."""

import csv
import json
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis import cli
from granular_analysis.measure import harmonic as measure
from granular_analysis.measure.coherent import project
from granular_analysis.measure.harmonic import PHASES, by_cell, by_network, by_runs, by_theory, over_phases
from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.second_harmonic import second_harmonic
from granular_analysis.theory import cell as cell_module
from granular_analysis.theory.choice import wave_of
from granular_analysis.tools import harmonic as command
from granular_analysis.tools.compare import compare
from granular_analysis.tools.harmonic import harmonic, table
from granular_lmp import Record, Scene, run
from tests.conftest import members

SHORT = {"time.duration": 8.0, "time.sample": 1.0, "output.particles": 8.0}
ROWS = {"packing.rows": 8, "packing.columns": 3}
LAYERS = {"rows": [0, 7], "every": 2, "density": 4400.0}
PERFECT: dict[str, tuple[str, dict[str, Any]]] = {
    "hexagonal": ("tr_periodic", ROWS),
    "RT": ("tr_periodic", ROWS | {"wave.mode": "RT"}),
    "incremental": ("tr_periodic", ROWS | {"effects.shear_law": "incremental"}),
    "jkr": ("tr_periodic", ROWS | {"sphere.adhesion_law": "jkr"}),
    "standing": ("tr_periodic", ROWS | {"wave.form": "standing"}),
    "layers": ("tr_periodic", ROWS | {"inclusion": [LAYERS]}),
    "square": ("tr_square", {"wave.mode": "L"}),
    "chain": ("l_chain", {"packing.rows": 8, "packing.ends": "periodic"}),
    "oblique": ("tr_oblique", {}),
}
# Twelve integrations leave RTOL = 1e-9 each of the wave; C is made of sixteen thirds of those at half the amplitude
FLOOR = 5e-8
VACANCIES = Scene.load("tr_periodic").with_values(
    SHORT | {"packing.rows": 16, "packing.columns": 8, "output.particles": 1.0, "disorder.vacancies": 0.02}
)


def scene_of(name: str) -> Scene:
    shipped, values = PERFECT[name]
    return Scene.load(shipped).with_values(values | SHORT)


# Oblique waves run in the same crystal, and L on a square lattice is another branch
@pytest.mark.parametrize("name", members(PERFECT, "hexagonal", "RT"))
def test_theory_and_network_give_one_second_harmonic(name: str, tmp_path: Path) -> None:
    record = run(scene_of(name), tmp_path / "run")
    network, theory = by_network(record), by_theory(record.scene, record.tau)
    # Of the network second and fourth order part; what is left is the sixth, a² of the fourth
    left = record.scene.wave.amplitude**2 * network.errors.max() + FLOOR
    np.testing.assert_allclose(theory.amplitudes, network.amplitudes, rtol=0, atol=left)
    assert np.abs(theory.amplitudes).max() > 100 * left
    assert np.all(theory.errors + FLOOR > network.errors)


@pytest.mark.parametrize(
    ("mode", "waves"), [("TR", 8), *(pytest.param(*each, marks=pytest.mark.more) for each in (("TR", 12), ("L", 5)))]
)
def test_the_error_of_theory_is_one_to_ten_times_the_next_order_for_long(mode: str, waves: int, tmp_path: Path) -> None:
    cell = {"packing.rows": 34, "packing.columns": 3, "wave.wavenumber": 2 * pi * waves / 34, "wave.mode": mode}
    record = run(Scene.load("tr_periodic").with_values(SHORT | cell), tmp_path / "run")  # eight waves: on the resonance
    tau = np.array([20.0, 60.0, 120.0])
    fourth, error = by_network(record, tau).errors[:, 0], by_theory(record.scene, tau).errors[:, 0]
    assert np.all(error[1:] > fourth[1:])
    assert np.sqrt(np.mean(error**2)) < 10 * np.sqrt(np.mean(fourth**2))


def test_theory_has_no_ends_and_the_command_says_so(tmp_path: Path) -> None:
    held = Scene.load("tr_periodic").with_values(
        SHORT | {"packing.ends": "fixed", "packing.rows": 33, "time.allow_echo": True, "wave.amplitude": 0.02}
    )
    (tmp_path / "held.toml").write_text(held.to_toml())
    theory, cell = (harmonic([str(tmp_path / "held.toml")], way) for way in ("theory", "cell"))
    assert "second harmonic by theory, of a crystal without ends, in D0" in table(theory)
    assert "second harmonic by cell, in D0" in table(cell)
    assert "without ends" not in table(by_theory(scene_of("hexagonal"), [1.0]))
    apart = np.abs(theory.amplitudes - cell.amplitudes).max()
    assert apart > 10 * max(theory.errors.max(), cell.errors.max())  # what the ends change is no error of either


def test_another_density_and_another_start_are_seen(tmp_path: Path) -> None:
    record = run(scene_of("layers"), tmp_path / "run")
    network = by_network(record)
    for values in ({"inclusion": [LAYERS | {"density": 4380.0}]}, {"wave.phase": 0.01}):
        other = by_theory(record.scene.with_values(values), record.tau)
        assert np.abs(other.amplitudes - network.amplitudes).max() > 1e-3 * np.abs(network.amplitudes).max()


def test_it_is_the_closed_form_along_y() -> None:
    tau = np.arange(0.0, 9.0)
    still = np.zeros(len(tau))
    for phase in (0.0, 0.7):
        scene = scene_of("hexagonal").with_values({"wave.phase": phase})
        wave = wave_of(Record.of_centre(tau, still, still, still, scene))
        closed = second_harmonic(wave.mode, wave.contact.closed, wave.amplitude, tau, phase=phase)
        # In TR waves p at the centre is of second order, and all of it turns with 2θ
        assert np.abs(by_theory(scene, tau).amplitudes[:, 0].real - closed).max() < 1e-12


# --- crystals that are not perfect ---

SMALL = {"packing.columns": 4, "time.duration": 8.0, "time.sample": 1.0, "output.particles": 8.0}
IMPERFECT: dict[str, dict[str, Any]] = {
    "vacancies": {"disorder.vacancies": 0.02},
    "incremental": {"disorder.vacancies": 0.02, "effects.shear_law": "incremental"},
    "radii": {"disorder.radius": 2.5e-5},
    "jkr": {"disorder.radius": 2.5e-5, "sphere.adhesion_law": "jkr"},
    "compressed": {"packing.contact_force": 1e-6, "disorder.vacancies": 0.02},
    "densities, standing": {"disorder.density": 0.1, "wave.form": "standing"},
    "square, one heavy": {"packing.lattice": "square", "inclusion": [{"spheres": [[4, 2]], "density": 9000.0}]},
    "without rotation": {"effects.rotation": False, "disorder.density": 0.1},
    "steel in silica": {
        "inclusion": [{"rows": [8, 11], "density": 7850.0, "youngs_modulus": 210e9, "poisson_ratio": 0.3}]
    },
    "held rows": {"packing.ends": "fixed", "packing.rows": 17, "time.allow_echo": True, "disorder.vacancies": 0.02},
}


# The laws have their theory in perfect crystals above; held rows have vacancies too
@pytest.mark.parametrize("name", members(IMPERFECT, "vacancies", "incremental", "jkr", "compressed"))
def test_the_second_order_of_a_cell_is_that_of_its_network(name: str, tmp_path: Path) -> None:
    record = run(Scene.load("tr_periodic").with_values(SMALL | IMPERFECT[name]), tmp_path / "run")
    cell, network = by_cell(record), by_network(record)
    left = record.scene.wave.amplitude**2 * network.errors.max() + FLOOR
    np.testing.assert_allclose(cell.amplitudes, network.amplitudes, rtol=0, atol=left)
    assert np.abs(cell.amplitudes).max() > 50 * left
    assert np.all(cell.errors + FLOOR > network.errors)


def test_a_cell_of_another_density_is_told_from_the_network(tmp_path: Path) -> None:
    scene = Scene.load("tr_periodic").with_values(SMALL | IMPERFECT["square, one heavy"])
    other = scene.with_values({"inclusion.1.density": 8900.0})
    cell, network = by_cell(run(scene, tmp_path / "a")), by_network(run(other, tmp_path / "b"))
    assert np.abs(cell.amplitudes - network.amplitudes).max() > 1e-3 * np.abs(network.amplitudes).max()


def test_a_cell_of_a_perfect_crystal_has_its_theory_for_long(tmp_path: Path) -> None:
    record = run(scene_of("oblique").with_values({"packing.rows": 12, "packing.columns": 12}), tmp_path / "run")
    tau = np.linspace(0, 100, 21)
    cell, theory = by_cell(record, tau), by_theory(record.scene, tau)
    # The wave vector fits the cell of the run, which rests 1e-10 strained, and phases turn by 1e2
    np.testing.assert_allclose(cell.amplitudes, theory.amplitudes, rtol=0, atol=1e-6 * np.abs(theory.amplitudes).max())


def test_a_cell_takes_any_number_of_moments_at_once(phases: list[Record], monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for at_once in (1, 1000, 10**9):
        monkeypatch.setattr(cell_module, "_BATCH", at_once)
        found.append(by_cell(phases[0], [0.0, 2.0]).amplitudes)
    np.testing.assert_allclose(found[1:], [found[0]] * 2, rtol=0, atol=1e-12 * np.abs(found[0]).max())


def test_contacts_that_open_and_dashpots_are_not_in_a_cell(tmp_path: Path) -> None:
    strong = Scene.load("tr_periodic").with_values(
        SMALL | IMPERFECT["vacancies"] | {"wave.amplitude": 1.5, "time.duration": 1.0, "output.particles": 1.0}
    )
    with pytest.raises(ValueError, match="the wave opens a contact: .* times the stretch at which it opens"):
        by_cell(run(strong, tmp_path / "strong"), np.arange(9.0))
    damped = Scene.load("tr_damped").with_values(SHORT | ROWS | {"packing.ends": "periodic", "wave.wavenumber": pi / 4})
    with pytest.raises(ValueError, match="the second order of a cell leaves out viscosity and restitution"):
        by_cell(run(damped, tmp_path / "damped"))


# --- a crystal with vacancies ---


@pytest.fixture(scope="module")
def phases(tmp_path_factory: pytest.TempPathFactory) -> list[Record]:
    """Runs of a crystal with vacancies, with six phases."""
    folder = tmp_path_factory.mktemp("phases")
    return [run(VACANCIES.with_values({"wave.phase": float(each)}), folder / f"{each:.2f}") for each in PHASES]


def test_with_vacancies_the_network_has_what_lammps_has_over_phases(phases: list[Record]) -> None:
    network, lammps = by_network(phases[0]), by_runs(phases)
    # The runs hold fourth order; and their step h leaves (Ωh)²/24 of the phase 2Ωτ, 1.7e-3 of C for Ω = 1, h = 0.05
    left = network.errors.max() + 2e-3 * np.abs(network.amplitudes).max()
    np.testing.assert_allclose(lammps.amplitudes, network.amplitudes, rtol=0, atol=left)
    perfect = by_theory(phases[0].scene.with_values({"disorder.vacancies": 0.0}), network.tau)
    assert np.abs(perfect.amplitudes - network.amplitudes).max() > 5e-2 * network.strength.max()
    assert network.errors.max() < 1e-2 * network.strength.max()
    # One run cannot part the second harmonic from the wave that vacancies scatter to 2k
    first = first_snapshot(phases[0])
    places, k = measure._places(phases[0], first)
    mixed = project(places, phases[0].snapshots().stack("displacement"), k.tolist()).amplitudes[1]
    assert np.abs(mixed - network.amplitudes).max() > network.strength.max()


def test_the_start_of_a_run_is_a_plane_wave_or_refused(phases: list[Record], monkeypatch: pytest.MonkeyPatch) -> None:
    first = first_snapshot(phases[0])
    motion = first.state.motion
    wave = measure._Started.of(phases[0]).wave
    assert np.allclose(wave.real, motion, rtol=0, atol=1e-3 * np.abs(motion).max(axis=1)[:, None])
    bent = motion.copy()
    bent[1, 3] += 0.5 * first.length
    monkeypatch.setattr(measure, "first_snapshot", lambda _: replace(first, state=replace(first.state, motion=bent)))
    with pytest.raises(ValueError, match="not a plane wave that fills the cell"):
        by_network(phases[0])


# --- phases ---


def test_what_turns_twice_is_found_among_other_orders() -> None:
    orders = np.array([0.3j, 5.0, 0.2 + 0.1j])
    made = sum(each * np.exp(1j * number * PHASES) for number, each in enumerate(orders))
    value, error = over_phases(PHASES, made + 7 * np.exp(-2j * PHASES))
    assert abs(value - orders[2]) < 1e-13
    assert error < 1e-13
    value, error = over_phases(PHASES, made + 1e-3 * np.cos(3 * PHASES))
    assert abs(value - orders[2]) < 1e-13
    assert error > 5e-4
    assert abs(over_phases(PHASES, 1.01 * made)[0] - orders[2]) > 1e-3


def test_too_few_phases_and_other_runs_are_refused(phases: list[Record]) -> None:
    with pytest.raises(ValueError, match="has 5 values that do not separate the orders; use six"):
        by_runs(phases[:5])
    with pytest.raises(ValueError, match="has 6 values that do not separate the orders"):
        by_runs([*phases[:3], *phases[:3]])
    other = replace(phases[1], scene=phases[1].scene.with_values({"wave.amplitude": 0.1}))
    with pytest.raises(ValueError, match="differ in more than wave.phase"):
        by_runs([phases[0], other, *phases[2:]])


def test_what_no_way_holds_is_refused_by_name(phases: list[Record]) -> None:
    info, scene = phases[0].info, phases[0].scene
    sliding = info | {"effects": info["effects"] | {"sliding": {"on": True}}}
    with pytest.raises(ValueError, match=r"leaves out effects\.sliding"):
        by_network(replace(phases[0], info=sliding))
    packet = scene.with_values({"packing.rows": 64, "envelope.length": 8.0})
    with pytest.raises(ValueError, match=r"leaves out an envelope"):
        by_network(replace(phases[0], scene=packet))


# --- the command ---


def test_the_command_takes_scenes_runs_and_sweeps_and_writes_what_it_found(
    phases: list[Record], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(phases[0].folder)
    assert cli.main(["harmonic", folder, "--csv", str(tmp_path / "c.csv"), "--json", str(tmp_path / "c.json")]) == 0
    assert "second harmonic by cell" in capsys.readouterr().out
    said = json.loads((tmp_path / "c.json").read_text())
    with (tmp_path / "c.csv").open() as stream:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(stream)]
    assert [row["tau"] for row in rows] == phases[0].tau.tolist()
    mean = np.mean([row["along_re"] ** 2 + row["along_im"] ** 2 for row in rows])
    assert said["along"]["strength"] == pytest.approx(np.sqrt(mean), rel=1e-12)
    assert said["by"] == "cell"
    assert "by runs" in table(harmonic([str(each.folder) for each in phases]))
    assert "by theory" in table(harmonic(["tr_square"]))
    with pytest.raises(SystemExit, match="leaves out disorder.vacancies = 0.02"):
        cli.main(["harmonic", folder, "--by", "theory"])
    capsys.readouterr()


def test_a_scene_without_a_wave_is_told_so() -> None:
    chain = Scene.load("solitary_chain")
    struck = Record(np.zeros(1), {}, chain)
    for way in (by_cell, by_network):
        with pytest.raises(ValueError, match="wave: missing table"):
            way(struck)


def test_the_command_takes_a_scene_that_is_not_perfect(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # In this process; `test_theory_has_no_ends_and_the_command_says_so` starts granular-lmp
    sample = {"time.duration": 1.0, "output.particles": 1.0}
    monkeypatch.setattr(command, "begun", lambda scene, folder: run(scene.with_values(sample), Path(folder, "run")))
    narrow = VACANCIES.with_values({"packing.columns": 4})
    (tmp_path / "scene.toml").write_text(narrow.to_toml())
    scene = ["harmonic", str(tmp_path / "scene.toml"), "--json", str(tmp_path / "c.json")]
    found = {}
    for way in ([], ["--by", "network"]):
        assert cli.main([*scene, *way]) == 0
        said = json.loads((tmp_path / "c.json").read_text())
        found[said["by"]] = said["along"]["strength"]
    assert found["cell"] == pytest.approx(found["network"], rel=1e-4)  # both of second order
    damped = narrow.with_values({"effects.viscosity": 2e-8, "time.duration": 2.0})
    (tmp_path / "scene.toml").write_text(damped.to_toml())
    assert cli.main(scene) == 0
    assert "second harmonic by network" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="theory: the theory of a crystal leaves out disorder.vacancies = 0.02"):
        cli.main([*scene, "--by", "theory"])


# --- the same theory as a reference ---


@pytest.mark.parametrize("name", ["square", "chain", "layers", "standing"])
def test_compare_takes_the_second_order_of_a_crystal_where_it_has_no_snapshots(name: str, tmp_path: Path) -> None:
    record = run(scene_of(name).with_values({"output.particles": 0.0, "wave.amplitude": 0.02}), tmp_path / "run")
    found = compare(record)
    assert found.theory == "crystal-second-order"
    assert "compared with the second order of its crystal, as" in found.notes[0]
    # Third order and LAMMPS's step h, (Ωh)²/24 of a phase Ωτ: 1e-3 for Ω = 1, h = 0.05 and τ = 8
    assert all(error is None or error < 2e-3 for error in found.error.values())
    wrong = compare(record.with_signals(p=1.01 * record.p, q=1.01 * record.q)).error
    assert max(wrong["p"] or 0.0, wrong["q"] or 0.0) > 8e-3


def test_in_the_papers_crystal_it_is_the_closed_form(tmp_path: Path) -> None:
    record = run(scene_of("hexagonal"), tmp_path / "run")
    ours, closed = (compare(record, name).signals for name in ("crystal-second-order", "second-order"))
    np.testing.assert_allclose(ours, closed, rtol=0, atol=1e-11)  # sums of numbers below 1, of some hundred steps
