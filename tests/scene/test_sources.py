"""Sources: what a scene may ask of them, and what they do in LAMMPS beside the linear answer of the crystal."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.norms import relative_error
from granular_analysis.theory import signals
from granular_analysis.theory.catalogue import NETWORK, REFERENCES, missing
from granular_analysis.theory.choice import traits_of
from granular_analysis.theory.contact import Contact
from granular_analysis.tools import compare
from granular_lmp import Record, Scene, build, run
from granular_lmp.cli import main
from granular_lmp.effects.case import Case
from granular_lmp.errors import EffectError, SceneError
from granular_lmp.lammps.checkpoints import SPEED
from granular_lmp.problem import prepare
from granular_lmp.rest.absorption import quiet_end_of, quiet_side, waves_at_ends
from granular_lmp.runs.snapshots import Snapshots
from granular_lmp.scene.document import note
from granular_lmp.scene.signals import SIGNALS
from tests.conftest import PAPER
from tests.linear_answer import Crystal, Load, response
from tests.manual import Measure, Mutant, verifies

PUSH: dict[str, Any] = {"spheres": [[6, 5]], "force": "y", "signal": "burst", "cycles": 2.0, "frequency": 1.2}
TURN: dict[str, Any] = {"spheres": [[6, 9], [8, 8]], "force": "torque", "amplitude": 0.5, "signal": "ricker"}
MOVE: dict[str, Any] = {"spheres": [[3, 3]], "motion": "x", "ramp": 6.0, "delay": 0.7, "frequency": 0.5}
AT_REST = {"wave.form": "none", "wave.amplitude": 1e-3, "wave.wavenumber": 1.0}
SHEET = PAPER.with_values(
    AT_REST
    | {"packing.rows": 16, "packing.columns": 16, "packing.ends": "periodic", "time.duration": 12.0}
    | {"output.particles": 0.5, "source": [PUSH, TURN | {"frequency": 2.0}, MOVE], "name": "sheet"}
)
STRIP = PAPER.with_values(
    AT_REST
    | {"packing.rows": 31, "packing.columns": 3, "packing.ends": "fixed", "time.duration": 20.0}
    | {"output.particles": 0.5, "source": [{"rows": [15, 15], "motion": "x", "ramp": 10.0}], "name": "strip"}
)


def crystal_of(snapshots: Snapshots) -> Crystal:
    """The crystal of a run, as theory takes it: lengths in lattice constants."""
    sphere, low = snapshots.scene.sphere, snapshots.crystal.get_celldisp().ravel()[:2]
    constant = 2 * (1 - sphere.overlap_ratio)
    size = snapshots.crystal.cell.lengths()[:2] / constant
    cell = tuple(float(each) if there else np.inf for each, there in zip(size, snapshots.crystal.pbc, strict=False))
    contact = Contact(sphere.poisson_ratio, overlap_ratio=sphere.overlap_ratio)
    return Crystal((snapshots.rest - low) / constant, cell, contact, snapshots.held)


def fields_of(snapshots: Snapshots) -> np.ndarray:
    """Displacements and velocities (2, T, N, 3) of a run."""
    moved, turned, velocity, spin = snapshots.stacks("displacement", "rotation", "velocity", "spin")
    return np.array([np.concatenate([a, b[..., None]], axis=-1) for a, b in ((moved, turned), (velocity, spin))])


def extrapolated(scene: Scene, folder: Path) -> tuple[np.ndarray, Snapshots]:
    """Fields of a scene from two steps by Richardson, whose error is of fourth order."""
    runs = [run(scene.with_values({"time.timestep": step}), folder / str(step)).snapshots() for step in (0.1, 0.05)]
    coarse, fine = map(fields_of, runs)
    return (4 * fine - coarse) / 3, runs[-1]


def worst(found: np.ndarray, expected: np.ndarray, spheres: Sequence[int] | np.ndarray) -> float:
    """Return the largest relative error of u, v and φ over some spheres."""
    pairs = [(found[:, spheres, k], expected[:, spheres, k]) for k in range(3)]
    return max(relative_error(*pair) for pair in pairs if np.abs(pair[1]).max() > 1e-9)  # a mirror keeps some at rest


# --- in LAMMPS -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, Snapshots]:
    return extrapolated(SHEET, tmp_path_factory.mktemp("sheet"))


LOADS = [
    Load([101], "y", signals.burst(1.2, 2.0)),
    Load([105, 136], "torque", lambda tau: 0.5 * signals.ricker(2.0)(tau)),
    Load([51], "x", signals.tone(0.5, 6.0, delay=0.7), moves=True),
]


@verifies(
    "Three sources in a sheet: force burst, torque wavelet, moved sphere; fields and velocities",
    reference="other code: the sum over modes of the linear crystal",
    tolerance=0.001,
    reason="second order is a = 1e-3 of the field times numbers of order 0.1",
    mutant=Mutant(
        "granular_lmp/lammps/sources.py", 'return f"{s}^3*(10-15*{s}+6*{s}^2)"', 'return f"{s}^3*(10-15*{s}+5*{s}^2)"'
    ),
)
def test_forces_torques_and_motions_make_the_waves_of_the_linear_crystal(
    sheet: tuple[np.ndarray, Snapshots], measured: Measure
) -> None:
    found, snapshots = sheet
    expected = response(crystal_of(snapshots), LOADS, snapshots.tau)
    apart = snapshots.crystal.get_all_distances(mic=True)[:, [101, 105, 136, 51]].min(axis=1)
    near, far = np.flatnonzero(apart < 4.1), np.flatnonzero(apart > 8)  # radii: next neighbours; four spheres away
    assert len(near) > 20
    assert len(far) > 40
    measured(worst(found[0], expected[0], near))
    measured(worst(found[0], expected[0], far))
    measured(worst(found[1], expected[1], np.arange(256)))


@pytest.mark.parametrize("source", range(3))
def test_five_percent_more_of_a_source_are_seen(source: int, sheet: tuple[np.ndarray, Snapshots]) -> None:
    found, snapshots = sheet
    load = LOADS[source]
    more = Load(load.spheres, load.axis, lambda tau: 1.05 * load.signal(tau), load.moves)
    wrong = [*LOADS[:source], more, *LOADS[source + 1 :]]
    expected = response(crystal_of(snapshots), wrong, snapshots.tau)[0]
    assert worst(found[0], expected, np.arange(256)) > 5e-3


def test_spheres_that_are_turned_by_hand_make_the_waves_of_the_linear_crystal(tmp_path: Path) -> None:
    turned = MOVE | {"motion": "rotation"}
    scene = SHEET.with_values({"packing.rows": 10, "packing.columns": 10, "source": [turned], "output.particles": 1.0})
    found, snapshots = extrapolated(scene, tmp_path)
    signal = signals.tone(0.5, 6.0, delay=0.7)
    expected = response(crystal_of(snapshots), [Load([33], "rotation", signal, moves=True)], snapshots.tau)
    free = np.setdiff1d(np.arange(100), 33)
    assert worst(found[0], expected[0], free) < 1e-3  # as above
    assert worst(found[1], expected[1], np.arange(100)) < 1e-3
    # The sphere turns as it is told, to the rounding of an angle of 1e-7, and does not move
    np.testing.assert_allclose(found[0][:, 33, 2], signal(snapshots.tau), rtol=0, atol=1e-8)
    assert not found[0][:, 33, :2].any()
    later = response(
        crystal_of(snapshots), [Load([33], "rotation", signals.tone(0.5, 6.0, delay=0.75), moves=True)], snapshots.tau
    )
    assert worst(found[0], later[0], free) > 5e-3  # a step later is seen


def test_a_shaken_row_makes_the_waves_of_the_linear_strip(tmp_path: Path) -> None:
    found, snapshots = extrapolated(STRIP, tmp_path)
    load = Load([45, 46, 47], "x", signals.tone(prepare(STRIP).wave.mode.frequency, 10.0), moves=True)
    expected = response(crystal_of(snapshots), [load], snapshots.tau)[0]
    row = snapshots.crystal.arrays["row"]
    assert worst(found[0], expected, np.flatnonzero(np.abs(row - 15) == 1)) < 1e-3  # as above
    assert worst(found[0], expected, np.flatnonzero(np.abs(row - 15) == 8)) < 1e-3


def test_the_power_of_sources_is_the_change_of_energy(tmp_path: Path) -> None:
    scene = SHEET.with_values(
        {"packing.rows": 10, "packing.columns": 8, "output.particles": 0.1, "time.sample": 0.1}
        | {"source": [PUSH | {"spheres": [[4, 4]]}, TURN | {"spheres": [[2, 1]], "frequency": 2.0}]}
    )
    (field, velocity), snapshots = extrapolated(scene, tmp_path)
    crystal, tau = crystal_of(snapshots), snapshots.tau
    power = crystal.strength("y") * signals.burst(1.2, 2.0)(tau) * velocity[:, 36, 1]
    power += crystal.strength("torque") * 0.5 * signals.ricker(2.0)(tau) * velocity[:, 17, 2]
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2) * 0.1])
    # The trapezoidal rule errs by h²/12 of the slope of the power, which is taken from it
    work -= 0.1**2 / 12 * (np.gradient(power, 0.1, edge_order=2) - np.gradient(power, 0.1, edge_order=2)[0])
    energy = crystal.energy(field, velocity)
    assert energy[-1] > 0.01  # in m (D0/t0)²
    # a = 1e-3 times numbers of order 0.1, and the fourth order of the samples
    assert np.abs(work - energy).max() < 1e-3 * energy.max()


def test_the_first_row_as_a_source_is_the_driven_row(tmp_path: Path) -> None:
    driven = Scene.load("tr_driven").with_values({"packing.rows": 21, "time.duration": 25.0, "wave.phase": 0.3})
    # q = −u: the driven row moves against x
    row = {"rows": [0, 0], "motion": "x", "phase": 0.3 - np.pi}
    changes = {"wave.form": "none", "wave.phase": 0.0, "envelope.ramp": 20.0, "source": [row]}
    a, b = (
        fields_of(run(scene, tmp_path / str(k)).snapshots())
        for k, scene in enumerate((driven, driven.with_values(changes)))
    )
    # Rounding of positions 9 µm from the origin, 1e-12 nm of D0 = 1e-2 nm, over 500 steps
    np.testing.assert_allclose(a, b, atol=1e-8)


def test_each_signal_is_what_it_is_called(tmp_path: Path) -> None:
    known: dict[str, tuple[dict[str, Any], Callable[[np.ndarray], np.ndarray]]] = {
        "tone": ({"phase": 0.4, "ramp": 3.0, "delay": 1.0}, signals.tone(0.8, 3.0, 0.4, 1.0)),
        "burst": ({"phase": -0.4, "cycles": 1.5, "delay": 2.0}, signals.burst(0.8, 1.5, -0.4, 2.0)),
        "chirp": ({"sweep": 2.5, "cycles": 3.0, "phase": 0.2, "delay": 1.0}, signals.chirp(0.8, 2.5, 3.0, 0.2, 1.0)),
        "ricker": ({"delay": 0.5}, signals.ricker(0.8, 0.5)),
        "step": ({"ramp": 5.0, "delay": 1.5}, signals.step(5.0, 1.5)),
    }
    sources = [
        {"spheres": [[2, 2 * k]], "motion": "xy"[k % 2], "signal": name, "amplitude": 0.5 + k}
        | ({} if name == "step" else {"frequency": 0.8})
        | keys
        for k, (name, (keys, _)) in enumerate(known.items())
    ]
    assert {*known, "samples"} == {*SIGNALS}  # those are tests/scene/test_samples.py
    changes = {"packing.rows": 6, "packing.columns": 10, "time.duration": 20.0, "source": sources}
    scene = SHEET.with_values(changes | {"output.particles": 1.0})
    snapshots = run(scene, tmp_path / "run").snapshots()
    moved, turned, velocity = snapshots.stacks("displacement", "rotation", "velocity")
    for k, (_, signal) in enumerate(known.values()):
        sphere = 20 + 2 * k
        # Rounding of positions 4 µm from the origin, 1e-12 nm of D0 = 2.5e-4 nm
        np.testing.assert_allclose(moved[:, sphere, k % 2], (0.5 + k) * signal(snapshots.tau), atol=1e-8)
        assert not moved[:, sphere, 1 - k % 2].any()
        assert not turned[:, sphere].any()
        # Rates are those of the instant; differences over 1e-4 err by half of that where a burst begins to curve
        rate = (0.5 + k) * slope(signal, snapshots.tau)
        np.testing.assert_allclose(velocity[:, sphere, k % 2], rate, atol=2e-5)


def slope(signal: Callable[[np.ndarray], np.ndarray], tau: np.ndarray) -> np.ndarray:
    return (signal(tau + 1e-4) - signal(tau - 1e-4)) / 2e-4


def raw(snapshots: Snapshots, sphere: int, column: str) -> np.ndarray:
    """A column of a dump as LAMMPS wrote it, in the units of a record."""
    lines = snapshots.path.read_text().split("\n")
    names = next(line for line in lines if line.startswith("ITEM: ATOMS")).split()[2:]
    values = [line.split() for line in lines if line.startswith(f"{sphere + 1} ")]
    units, scene = snapshots.scene.units, snapshots.scene
    speed = units.number(scene.displacement_amplitude, length=1) / units.number(scene.scale.time, time=1)
    factor = units.number(scene.sphere.radius, length=1) if column.startswith("omega") else 1.0
    return np.array([float(each[names.index(column)]) for each in values if len(each) == len(names)]) * factor / speed


@pytest.mark.parametrize(("motion", "column", "late"), [("x", "vx", 0.5), ("rotation", "omegaz", -0.5)])
def test_rates_of_moved_spheres_are_of_the_instant_at_every_step(
    motion: str, column: str, late: float, tmp_path: Path
) -> None:
    """LAMMPS has the velocity of half a step ago, and the spin of half a step ahead: errors of first order."""
    signal, errors = signals.tone(0.5, 6.0, delay=0.7), []
    watched = {"monitor": [{"name": "one", "spheres": [[3, 3]]}], "source": [MOVE | {"motion": motion}]}
    scene = SHEET.with_values({"packing.rows": 6, "packing.columns": 10, "time.duration": 12.0} | watched)
    for step in (0.1, 0.05):
        found = run(scene.with_values({"time.timestep": step}), tmp_path / f"{step}")
        snapshots, one = found.snapshots(), found.monitor("one")
        written, exact = raw(snapshots, 33, column), slope(signal, snapshots.tau)
        np.testing.assert_allclose(written[1:], slope(signal, snapshots.tau - late * step)[1:], atol=step**2)
        errors.append(np.abs(written - exact)[1:].max())
        velocity, spin = snapshots.stacks("velocity", "spin")
        of_all, of_one = (velocity[:, 33, 0], one.velocity[:, 0, 0])
        if motion == "rotation":
            of_all, of_one = spin[:, 33], one.spin[:, 0]
        np.testing.assert_allclose(of_all, exact, atol=1e-6)
        np.testing.assert_allclose(of_one, slope(signal, one.tau), atol=1e-6)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.1)


SHAKEN = SHEET.with_values(
    {"packing.rows": 8, "packing.columns": 6, "time.duration": 60.0, "output.particles": 0.0}
    | {"output.checkpoint": 48 * 100 / SPEED / 60}
    | {
        "source": [
            PUSH | {"spheres": [[6, 5]], "cycles": 8.0},
            MOVE,
            TURN | {"spheres": [[1, 1]], "frequency": 0.4},
            {"spheres": [[5, 2]], "motion": "rotation", "frequency": 0.7},
        ]
    }
)


@pytest.mark.more
def test_the_module_and_the_program_write_the_same_bytes(tmp_path: Path) -> None:
    for launcher in ("module", "lmp"):  # that a stopped run does: tests/runs/test_continued.py
        run(SHAKEN, tmp_path / launcher, launcher=launcher)
    module, program = ((tmp_path / name / "dump.centre").read_bytes() for name in ("module", "lmp"))
    assert module == program


def test_sources_that_turn_spheres_track_their_angles_and_say_so() -> None:
    untracked = SHEET.with_values({"effects.tracking": False})
    assert build(untracked).input_text == build(SHEET).input_text
    said = (
        'effects.tracking = false is read as true: source 2: force = "torque": turns the dipole that tracks the angle'
    )
    assert said in prepare(untracked).warnings()
    assert said not in prepare(SHEET).warnings()
    assert not prepare(untracked.with_values({"source": [PUSH, MOVE]})).on["tracking"]


def test_a_source_that_opens_contacts_against_the_estimate_fails_the_run(tmp_path: Path) -> None:
    # Eight rows gather speed together: each is pushed by less than opens a contact by the estimate, all by more
    pull = {"rows": [4, 11], "force": "y", "amplitude": 9.0, "signal": "step", "ramp": 1.0}
    scene = SHEET.with_values({"wave.amplitude": 0.1, "source": [pull], "time.duration": 16.0})
    assert not prepare(scene).on["contact_opening"]
    with pytest.raises(EffectError, match="contacts opened"):
        run(scene, tmp_path / "run")


def test_sources_shake_crystals_that_are_not_perfect(tmp_path: Path) -> None:
    holes = {"inclusion": [{"spheres": [[6, 6]], "vacancy": True}, {"spheres": [[3, 3]], "density": 9000.0}]}
    record = run(SHEET.with_values(holes | {"time.duration": 6.0}), tmp_path / "run")
    tau = record.snapshots().tau
    moved = record.snapshots().stack("displacement")[:, 51]
    np.testing.assert_allclose(moved[:, 0], signals.tone(0.5, 6.0, delay=0.7)(tau), atol=1e-8)  # rounding, as above
    with pytest.raises(SceneError, match=r"source 1: sphere \[6, 6\]: is a vacancy"):
        prepare(SHEET.with_values(holes | {"source.1.spheres": [[6, 6]]}))


def test_a_tolerance_is_met(tmp_path: Path) -> None:
    strip = {"packing.rows": 21, "source.1.rows": [8, 8], "source.1.ramp": 5.0, "wave.amplitude": 0.02}
    scene = STRIP.with_values(strip | {"output.particles": 0.0, "time.tolerance": 1e-3, "time.duration": 8.0})
    found = run(scene, tmp_path / "run")
    exact = run(scene.with_values({"time.timestep": 0.003125}), tmp_path / "fine")
    assert relative_error(found.q, exact.q) < 1e-3  # the tolerance itself
    assert found.info["error_estimate"]["q"] < 1e-3


# --- what is said of them --------------------------------------------------------------------------------------------


def test_no_closed_form_holds_sources_and_the_network_judges_them(tmp_path: Path) -> None:
    record = run(SHEET.with_values({"time.duration": 2.0}), tmp_path / "run")
    assert {"source", "wave.form = 'none'"} <= traits_of(record)
    assert all("source" in missing(theory, traits_of(record)) for theory in REFERENCES if theory != NETWORK)
    assert compare.compare(record).theory == NETWORK


@pytest.mark.usefixtures("tried")
def test_effects_and_check_name_sources_with_their_cost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "sheet.toml"
    path.write_text(SHEET.to_toml(), encoding="utf-8")
    assert main(["effects", str(path)]) == 0
    assert "source 3         on   -                +110     tone of motion along x at 0.5" in capsys.readouterr().out
    assert main(["effects", str(path), "--json"]) == 0
    (first, *_) = json.loads(capsys.readouterr().out)["sources"]
    assert first == {"does": "burst of force along y at 1.2 rad per t0 on 1 sphere", "cost_in_spheres": 30}
    assert main(["check", str(path)]) == 0
    assert "source    ricker of torque at 2 rad per t0 on 2 spheres, as much time as 30 spheres" in (
        capsys.readouterr().out
    )


# --- scenes ----------------------------------------------------------------------------------------------------------


def test_a_scene_is_read_back_from_its_text() -> None:
    assert Scene.loads(SHEET.to_toml()) == SHEET
    assert SHEET.with_values({"source.2.amplitude": 3.0}).source[1].amplitude == 3.0
    assert "[[source]]" not in PAPER.to_toml()


def test_the_usual_frequency_is_that_of_the_wave_and_hertz_are_turned_into_it() -> None:
    plain = prepare(STRIP)
    assert plain.sources[0].frequency == plain.wave.mode.frequency
    hertz = plain.wave.mode.frequency / (2 * np.pi * STRIP.sphere.time_scale)
    again = prepare(STRIP.with_values({"source.1.hertz": hertz})).sources[0].frequency
    assert again == pytest.approx(plain.wave.mode.frequency, rel=1e-14)  # rounding


def test_the_wave_is_a_unit_and_need_not_fit_a_periodic_cell() -> None:
    assert SHEET.wavenumber == 1.0
    assert not build(SHEET).data.wave.any()


def test_rotation_and_shear_are_called_for_whatever_the_unit() -> None:
    on = prepare(SHEET.with_values({"wave.mode": "L"})).on
    assert on["shear"]
    assert on["rotation"]


def test_a_prescribed_rotation_is_a_slip_of_contacts() -> None:
    still = {"spheres": [[3, 3]], "motion": "rotation", "frequency": 0.5}
    case = Case(SHEET.with_values({"source": [still]}))
    assert case.stretches[1].min() == pytest.approx(1e-3)  # a, on every contact
    assert Case(SHEET.with_values({"source": [still | {"motion": "x"}]})).stretches[1].min() < 0.9e-3


def test_whole_rows_need_three_columns_and_single_spheres_a_number() -> None:
    assert STRIP.with_values({"packing.columns": "auto"}).shape.columns == 3
    with pytest.raises(
        SceneError, match=r"packing\.columns = 'auto': must be a number where \[\[source\]\] has single"
    ):
        SHEET.with_values({"packing.columns": "auto"})


def test_the_echo_is_that_of_the_nearest_wall() -> None:
    def echo(row: int) -> float:
        return STRIP.with_values({"packing.rows": 101, "source.1.rows": [row, row]}).echo_time

    assert echo(50) > echo(10)
    assert echo(10) == echo(90)
    # The first row is no wall for the waves that it makes: they come back from the last one, as those of a driven row
    driven = Scene.load("tr_driven").with_values({"packing.rows": 101, "time.duration": 20.0})
    assert echo(0) == driven.echo_time
    # A sphere of the first row beside one of row 10 is in one source with it, and no less a wall for its waves
    for place, is_wall in (({"spheres": [[0, 0], [10, 0]]}, True), ({"rows": [0, 10]}, False)):
        moved = {"packing.rows": 101, "packing.columns": 4, "source": [{"motion": "x"} | place]}
        assert (STRIP.with_values(moved).echo_time == echo(10)) == is_wall


QUIET = STRIP.with_values({"packing.rows": 201, "absorb.rows": "auto", "absorb.reflection": 1e-2})


def test_quiet_ends_take_the_waves_of_the_sources() -> None:
    assert {wave.name for wave in waves_at_ends(QUIET)} == {"L", "TR"}
    assert quiet_side(QUIET) == "abs(y)"
    end = quiet_end_of(QUIET)
    assert end is not None
    assert end.reflection <= 1e-2
    assert np.isinf(QUIET.echo_time)
    for row, side in ((0, "y"), (200, "-y")):
        assert quiet_side(QUIET.with_values({"source.1.rows": [row, row]})) == side
    burst = QUIET.with_values({"source.1.signal": "burst", "source.1.ramp": 20.0, "source.1.cycles": 8.0})
    assert len(waves_at_ends(burst)) == 3 * len(waves_at_ends(QUIET))


def test_an_end_that_one_source_moves_sends_back_the_waves_of_the_others() -> None:
    ends = {"source": [{"rows": [0, 0], "motion": "x"}, {"rows": [40, 40], "force": "y"}]}
    walls, quiet = QUIET.with_values(ends | {"absorb.rows": 0}), QUIET.with_values(ends)
    assert (
        quiet.echo_time == walls.echo_time == QUIET.with_values({"source.1.rows": [40, 40], "absorb.rows": 0}).echo_time
    )
    with pytest.raises(SceneError, match="the echo of the walls reaches the centre of 201 rows"):
        quiet.with_values({"time.duration": 300.0})


def test_a_crystal_at_rest_needs_a_wave_number_only_for_the_frequency_of_a_source() -> None:
    tables = SHEET.with_values({"source": [PUSH, MOVE]}).given()
    own = {**tables, "wave": {key: value for key, value in tables["wave"].items() if key != "wavenumber"}}
    decks = [build(Scene.from_dict(each)).input_text.partition("\n") for each in (tables, own)]
    assert decks[0][2] == decks[1][2]  # all but the title
    for signal, known in {"burst": False, "ricker": False, "step": True}.items():
        own["source"] = [PUSH, {"spheres": [[6, 9]], "force": "y", "signal": signal}]
        if known:
            assert not Scene.from_dict(own).form.waves
        else:
            with pytest.raises(SceneError, match="source 2: frequency: missing; .* or hertz, or the wave.wavenumber"):
                Scene.from_dict(own)


@pytest.mark.parametrize(("key", "said"), [("source.1.delay", "tau, before the"), ("inclusion.2.radius", "m")])
def test_a_curve_over_a_key_of_an_array_of_tables_has_its_unit(key: str, said: str) -> None:
    assert note(key, Scene).startswith(said)


def test_a_record_of_a_crystal_at_rest_is_read_back(tmp_path: Path) -> None:
    record = run(STRIP.with_values({"time.duration": 4.0}), tmp_path / "run")
    assert Record.load(tmp_path / "run").q == pytest.approx(record.q)
    assert repr(record.scene).startswith("<Scene strip: 1 source, in units of the TR xi=1 a=0.001")
