"""Each face of a packing is held, free, periodic or a wall, in LAMMPS beside the network and the linear crystal."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.theory import signals
from granular_analysis.theory.errors import TheoryError
from granular_analysis.tools import compare
from granular_lmp import Record, Scene, build, run
from granular_lmp.crystal.lattices import CHAIN, FREE, HELD, PERIODIC, WALL, Shape, packed
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.effects.case import Case
from granular_lmp.effects.selection import select
from granular_lmp.errors import SceneError
from granular_lmp.problem import prepare
from granular_lmp.rest.at_rest import echo_at
from granular_lmp.studies.identity import names_of
from tests.beside_network import STEPS, extrapolated, network_fields
from tests.conftest import PAPER, latin, members
from tests.linear_answer import Load, response
from tests.manual import Measure, Mutant, verifies
from tests.scene.test_sources import crystal_of, worst
from tests.scene.test_sources import extrapolated as extrapolated_fields

PAGE = (Path(__file__).parents[2] / "docs" / "experiments.md").read_text("utf-8")
SIDES, ENDS = {"packing.sides": FREE}, {"packing.first": FREE, "packing.last": FREE}
SHEET = PAPER.with_values(
    {"packing.rows": 9, "packing.columns": 7, "wave.amplitude": 0.05, "time.allow_echo": True, "name": "faces"}
    | {"time.duration": 15.0, "time.sample": 1.0, "output.particles": 1.0}
)
WALLED = {"packing.first": WALL, "packing.last": WALL}
LOAD = {"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7}
FACES: dict[str, dict[str, Any]] = {
    "a free end": {"packing.last": FREE},
    "free sides": SIDES,
    "held sides": {"packing.sides": HELD},
    "a finite sheet": SIDES | ENDS,
    "a finite square sheet": SIDES | ENDS | {"packing.lattice": "square"},
    "a free chain": ENDS | {"packing.lattice": "chain", "packing.columns": 1, "wave.mode": "L"},
    "sides along periodic rows": SIDES | {"packing.ends": "periodic", "packing.rows": 8},
    "an oblique wave between ends": {"wave.direction": 37.0},
    "an oblique wave between sides": {"wave.direction": 37.0, "packing.ends": "periodic", "packing.rows": 8} | SIDES,
    "an oblique wave in a finite sheet": SIDES | ENDS | {"wave.direction": 37.0},
    "unequal spheres": SIDES | ENDS | {"disorder.radius": 5e-5},
    "a vacancy at a corner": SIDES | ENDS | {"inclusion": [{"spheres": [[0, 0]], "vacancy": True}]},
    "a striker at a corner": SIDES | ENDS | {"wave.form": "none", "striker": [{"spheres": [[0, 0]], "velocity": 1e-2}]},
    "a wall": {"packing.first": WALL},
    "walls along three sides": {"packing.first": WALL, "packing.sides": WALL},
    "walls under load": WALLED | LOAD,
    "a square sheet between four walls": WALLED | LOAD | {"packing.sides": WALL, "packing.lattice": "square"},
    "walls that adhere under load": WALLED | {"packing.contact_force": 1e-8},
    "walls of JKR spheres": WALLED | {"sphere.adhesion_law": "jkr"},
    "a chain between walls under load": WALLED
    | LOAD
    | {"packing.lattice": "chain", "packing.columns": 1, "wave.mode": "L"},
    "densities and vacancies between walls": WALLED | {"disorder.density": 0.1, "disorder.vacancies": 0.05},
    "unequal spheres between walls": WALLED | {"disorder.radius": 5e-5},
    "unequal spheres between walls under load": WALLED | LOAD | {"disorder.radius": 5e-5},
    "vacancies between walls under load": WALLED | LOAD | {"disorder.vacancies": 0.05},
    "a row of another material at a wall": WALLED | {"inclusion": [{"rows": [0, 0], "youngs_modulus": 1e10}]},
    "struck rows between held sides": {"packing.sides": HELD, "striker": [{"rows": [3, 3], "velocity": 1e-2}]},
}


# Of each, a case with one feature more stands beside it
MORE = ("free sides", "an oblique wave between sides", "a wall", "walls along three sides", "walls under load")
MORE += ("walls that adhere under load", "a chain between walls under load", "unequal spheres between walls")
MORE += ("a square sheet between four walls", "vacancies between walls under load", "a free end", "unequal spheres")
MORE += ("a finite sheet", "held sides")


@pytest.mark.parametrize("name", members(FACES, *MORE))
@verifies(
    "Faces held, free or walls, 27 crystals: every sphere in LAMMPS, in D0",
    reference="other code: the network of the same faces",
    tolerance=1e-06,
    reason="the step leaves at most 1e-7 once it is extrapolated, and the network errs less",
    mutant=Mutant(
        "granular_lmp/lammps/ends.py", "against.law(own.radius), problem", "against.law(1.01 * own.radius), problem"
    ),
)
def test_every_sphere_moves_as_in_the_network_of_the_same_faces(name: str, tmp_path: Path, measured: Measure) -> None:
    changes = FACES[name]
    # Contacts with walls are the stiffest: a row turns faster there, and half the step leaves 1/16 of the error
    steps = (0.025, 0.0125) if WALL in changes.values() else STEPS
    pair = extrapolated(SHEET.with_values(changes), tmp_path, steps)
    first = first_snapshot(pair.record)
    fields = network_fields(first, pair.record.tau)
    measured(np.abs(pair.fields - fields).max())
    # Another face is seen: none held where one is, else the first row
    held, height = np.asarray(first.network.held), first.network.position[:, 1]
    wrong = replace(first.network, held=np.zeros_like(held) if held.any() else height < height.min() + first.radius)
    other = network_fields(replace(first, network=wrong), pair.record.tau[:6])
    assert np.abs(pair.fields[:6] - other).max() > 1e-2


@pytest.mark.parametrize(
    ("changes", "force"),
    [({}, 0.0), (LOAD, np.sqrt(3) * 1e-7), (LOAD | {"packing.lattice": "square", "packing.sides": WALL}, 1e-7)],
    ids=["adhesion", "load", "square"],
)
def test_a_wall_is_where_its_contact_carries_the_force_of_the_row(changes: dict[str, Any], force: float) -> None:
    problem = prepare(SHEET.with_values(WALLED | changes))
    sphere, contacts = problem.scene.sphere, problem.rest.contacts
    at_wall = contacts.on_wall
    # Two contacts at 60° of the hexagonal lattice, one of the square one; twice the moduli and twice the radius
    np.testing.assert_allclose(contacts.contact_force[at_wall], force, rtol=1e-9, atol=1e-6 * sphere.holding_force)
    stiffer, pull = 2 * np.sqrt(2) * sphere.normal_coefficient, 2 * sphere.pull_off_force
    overlap = ((force + pull) / stiffer) ** (2 / 3)
    np.testing.assert_allclose(contacts.overlap[at_wall], overlap, rtol=1e-9)
    if not changes:
        assert overlap == pytest.approx(2 ** (-1 / 3) * sphere.static_overlap, rel=1e-9)
    y, place = problem.rest.atoms.positions[:, 1], (sphere.radius - overlap) / sphere.radius
    assert problem.rest.planes["ylo"] == pytest.approx(y.min() - place, abs=1e-12)
    assert problem.rest.planes["yhi"] == pytest.approx(y.max() + place, abs=1e-12)


def test_a_guard_sees_the_row_that_leaves_its_wall(tmp_path: Path) -> None:
    pull = {"rows": [0, 0], "force": "y", "signal": "step", "ramp": 4.0}
    scene = SHEET.with_values({"effects.friction": 0.5, "effects.sliding": True, "time.timestep": 0.05})
    for amplitude, opens in ((20.0, False), (100.0, True)):
        changes = WALLED | {"effects.contact_opening": True, "source": [pull | {"amplitude": amplitude}]}
        guards = run(scene.with_values(changes), tmp_path / str(amplitude)).info["guards"]
        assert (guards["open_contacts"]["value"] > 0) == opens


def test_a_source_at_the_corner_of_a_finite_sheet_makes_the_waves_of_the_linear_crystal(tmp_path: Path) -> None:
    source = {"spheres": [[0, 0]], "force": "x", "signal": "burst", "cycles": 2.0, "frequency": 0.8}
    scene = SHEET.with_values(SIDES | ENDS | {"wave.form": "none", "wave.amplitude": 1e-3, "source": [source]})
    found, snapshots = extrapolated_fields(scene, tmp_path)
    crystal = crystal_of(snapshots)
    assert np.isinf(crystal.cell).all()
    everyone = np.arange(63)
    expected = response(crystal, [Load([0], "x", signals.burst(0.8, 2.0))], snapshots.tau)[0]
    # Second order is a = 1e-3 of the field times numbers of order 0.1, and the fourth order of the step less
    assert worst(found[0], expected, everyone) < 1e-3
    elsewhere = response(crystal, [Load([6], "x", signals.burst(0.8, 2.0))], snapshots.tau)[0]
    assert worst(found[0], elsewhere, everyone) > 0.1
    # Nothing holds the sheet: it takes up the momentum of the force, and its centre of mass the way, k1 D0 = 2(κ+3) m
    tau = np.linspace(0, 15, 3001)
    speed = np.concatenate([[0], np.cumsum((signals.burst(0.8, 2.0)(tau)[1:] + signals.burst(0.8, 2.0)(tau)[:-1]) / 2)])
    way = np.trapezoid(speed, tau) * (tau[1] - tau[0]) / (2 * (scene.sphere.stiffness_ratio + 3)) / 63
    assert found[0][-1, :, 0].mean() == pytest.approx(way, rel=1e-3)


def test_half_of_the_push_at_a_corner_runs_along_the_face_as_the_page_says(tmp_path: Path) -> None:
    assert "*Half of the kinetic energy is in the two rows next to the\nfree face" in PAGE
    scene = Scene.load("corner_source").with_values({"time.duration": 34.0})
    snapshots = run(scene, tmp_path / "run").snapshots()
    velocity, spin = snapshots.stacks("velocity", "spin")
    energy = ((velocity**2).sum(axis=-1) + INERTIA_RATIO * spin**2)[np.argmin(np.abs(snapshots.tau - 34))]
    along = energy[snapshots.crystal.arrays["row"] < 2].sum()
    assert along / energy.sum() == pytest.approx(0.5, abs=0.02)


# --- the echo --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("changes", "mode"), latin([SIDES, {"packing.sides": HELD}, ENDS], ["TR", "L"]), ids=str)
def test_the_record_of_the_centre_is_that_of_the_endless_sheet_until_the_echo(
    changes: dict[str, Any], mode: str, tmp_path: Path
) -> None:
    cut = {"packing.columns": 25} if "packing.sides" in changes else {"packing.ends": "fixed", "packing.rows": 25}
    endless = SHEET.with_values(
        {"packing.ends": "periodic", "packing.rows": 8, "packing.columns": 8, "output.particles": 0.0}
        | {"wave.wavenumber": np.pi / 2, "wave.mode": mode, "time.timestep": 0.1, "time.duration": 24.0}
    )
    finite = endless.with_values(cut | changes)
    echo = finite.echo_time
    assert 7 < echo < 15
    records = [run(scene, tmp_path / name) for name, scene in (("endless", endless), ("finite", finite))]
    apart = np.max([np.abs(records[0].signals[name] - records[1].signals[name]) for name in ("p", "q", "phi")], axis=0)
    assert apart[records[0].tau <= echo].max() < 1e-6  # what the margin of an echo promises
    assert apart[records[0].tau > 1.5 * echo].max() > 1e-5


ROW = 2 / np.sqrt(3)  # a column in rows
BURST = {"force": "y", "signal": "burst", "frequency": 0.8}
BIG = SHEET.with_values({"packing.rows": 81, "packing.columns": 41})
WAYS: dict[str, tuple[dict[str, Any], float]] = {
    "a wave is disturbed by the nearest face": (SIDES, 20 * ROW),
    "or by an end": ({"packing.columns": 101} | ENDS | SIDES, 40),
    "waves of a sphere come back from the nearest face": (
        SIDES | ENDS | {"wave.form": "none", "source": [BURST | {"spheres": [[40, 10]]}]},
        30 * ROW,
    ),
    "those of a corner from the opposite ones": (
        SIDES | ENDS | {"wave.form": "none", "source": [BURST | {"spheres": [[0, 0]]}]},
        np.hypot(60 * ROW, 40),
    ),
    "those of a row from its sides": (
        SIDES | {"wave.form": "none", "source": [BURST | {"rows": [10, 10]}]},
        np.hypot(20 * ROW, 30),
    ),
    "those of a driven row too": (SIDES | {"wave.form": "driven"}, np.hypot(20 * ROW, 40)),
}


@pytest.mark.parametrize(("changes", "rows"), WAYS.values(), ids=WAYS)
def test_the_echo_takes_the_shortest_way_by_a_face(changes: dict[str, Any], rows: float) -> None:
    assert BIG.with_values(changes).echo_time == pytest.approx(2 * (rows - 3.5 * rows ** (1 / 3)), rel=1e-12)


@pytest.mark.parametrize("rows", [(10, 20), (3, 3), (30, 39)])
def test_the_echo_reaches_a_monitor_from_the_nearer_end(rows: tuple[int, int]) -> None:
    def echo(first: int, last: int) -> float:
        scene = BIG.with_values(ENDS | {"monitor": [{"name": "strip", "rows": [first, last]}]})
        return echo_at(scene, scene.monitor[0])

    first, last = rows
    assert echo(first, last) == pytest.approx(max(0.0, 2 * (first - 3.5 * first ** (1 / 3))), rel=1e-12)
    assert echo(80 - last, 80 - first) == echo(first, last)


def test_a_run_past_the_echo_of_a_side_is_refused_and_a_monitor_near_it_is_warned_of() -> None:
    with pytest.raises(SceneError, match=r"the echo of the faces reaches the centre of 81 rows x 41 columns at tau ="):
        BIG.with_values(SIDES | {"time.allow_echo": False, "time.duration": 60.0})
    near = {"monitor": [{"name": "corner", "spheres": [[78, 39]]}], "time.allow_echo": False}
    assert any(
        "monitor corner: the echo of the faces" in each for each in prepare(BIG.with_values(SIDES | near)).warnings()
    )


# --- what follows from a face ----------------------------------------------------------------------------------------


def test_a_finite_sheet_is_a_crystal_without_periodic_faces() -> None:
    crystal = packed(SHEET.sphere, Shape(5, 4, "fixed", first=FREE, last=FREE, sides=FREE))
    assert not crystal.pbc.any()
    assert not crystal.arrays["fixed"].any()
    low = crystal.get_celldisp().ravel()[:2]
    inside = crystal.positions[:, :2] - low
    # Every sphere is whole inside the box, and touches it on each side
    np.testing.assert_allclose(inside.min(axis=0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(crystal.cell.lengths()[:2] - inside.max(axis=0), 1.0, rtol=1e-12)


def test_held_sides_hold_the_first_and_the_last_column() -> None:
    crystal = packed(SHEET.sphere, Shape(5, 4, PERIODIC, sides=HELD))
    np.testing.assert_array_equal(crystal.arrays["fixed"], np.isin(crystal.arrays["column"], [0, 3]))


def test_a_box_follows_spheres_at_free_faces() -> None:
    def boundary(name: str) -> str:
        return build(SHEET.with_values(FACES[name])).input_text.split("boundary     ")[1].partition("\n")[0]

    assert boundary("a free end") == "p m p"
    assert boundary("held sides") == "f f p"
    assert boundary("a finite sheet") == "m m p"
    assert boundary("sides along periodic rows") == "m p p"
    assert boundary("a free chain") == "f m p"


def test_spheres_turn_at_sides_also_in_a_wave_that_turns_none() -> None:
    along = SHEET.with_values({"wave.mode": "L"})
    assert not prepare(along).on["rotation"]
    for sides in (FREE, HELD):
        assert prepare(along.with_values({"packing.sides": sides})).on["rotation"]


def test_a_crystal_that_nothing_holds_has_no_walls() -> None:
    assert not prepare(SHEET.with_values(SIDES | ENDS)).on["walls"]
    assert prepare(SHEET.with_values(SIDES | {"packing.last": FREE})).on["walls"]
    on = {each.name: each.on for each in select(SHEET.with_values(ENDS))}
    assert Case(SHEET.with_values(ENDS), on).scene.shape.infinite is False


def test_no_theory_of_the_infinite_lattice_is_taken_and_each_refuses_by_name(tmp_path: Path) -> None:
    record: Record = run(SHEET.with_values(SIDES), tmp_path / "run")
    found = compare.compare(record)
    assert found.theory == "network"
    assert found.lattice_error == {}
    # The time step of 0.05 leaves 4e-4
    assert max(value for value in found.error.values() if value is not None) < 2e-3
    for name in ("second-order", "hierarchy", "exact-lattice"):
        with pytest.raises(TheoryError, match=r"packing\.sides"):
            compare.compare(record, name)


def test_a_scene_that_says_nothing_of_its_faces_keeps_its_name() -> None:
    assert names_of(SHEET.with_values({"packing.first": "auto", "packing.sides": PERIODIC})) == names_of(SHEET)
    assert not set(names_of(SHEET.with_values(SIDES))) & set(names_of(SHEET))
    assert "sides" not in SHEET.to_toml()
    assert Scene.loads(SHEET.with_values(SIDES | ENDS).to_toml()) == SHEET.with_values(SIDES | ENDS)


def test_ends_that_are_auto_are_fixed_where_a_face_is_declared() -> None:
    scene = SHEET.with_values({"packing.ends": "auto", "packing.rows": "auto", "packing.last": FREE})
    assert (scene.shape.ends, scene.shape.first, scene.shape.last) == ("fixed", HELD, FREE)
    assert Shape(5, 1, PERIODIC, CHAIN).faces == {}


# --- quiet ends by name ---------------------------------------------------------------------------------------------

SHAKEN: dict[str, Any] = {
    "name": "one_end",
    "sphere": PAPER.to_dict()["sphere"],
    "packing": {"rows": 61, "columns": 3, "first": "free", "last": "quiet"},
    "wave": {"mode": "TR", "wavenumber": 1.475, "amplitude": 0.05, "form": "none"},
    "source": [{"rows": [29, 29], "force": "x", "ramp": 5.0}],
    "time": {"duration": 60.0, "timestep": 0.02, "allow_echo": True},
    "absorb": {"reflection": 0.1},
    "output": {"particles": 2.0},
}


def test_both_ends_that_are_quiet_by_name_are_those_of_absorb() -> None:
    scene = Scene.load("quiet_ends")
    named = scene.with_values({"packing.first": "quiet", "packing.last": "quiet"})
    assert build(named).input_text == build(scene).input_text
    without = {key: value for key, value in named.to_dict().items() if key != "absorb"}
    assert Scene.from_dict(without) == named  # rows are "auto" unless they are declared
    assert Scene.loads(named.to_toml()) == named


def test_an_end_alone_may_be_quiet_and_sends_back_no_echo() -> None:
    packing = {**SHAKEN["packing"], "last": "held"}
    one, held = Scene.from_dict(SHAKEN), Scene.from_dict({**SHAKEN, "packing": packing, "absorb": {}})
    assert (one.quiet, held.quiet) == (("last",), ())
    assert one.shape == held.shape
    # Behind the source the wave comes back from the last row, and by a longer way from the first
    assert held.echo_at((40, 40), (0, 2)) < one.echo_at((40, 40), (0, 2)) < np.inf
    assert one.echo_at((20, 20), (0, 2)) == held.echo_at((20, 20), (0, 2))


def test_bonded_balls_with_quiet_rows_at_the_held_end_alone_move_as_their_network(tmp_path: Path) -> None:
    tables = {
        "sphere": {
            "radius": 5e-3,
            "youngs_modulus": 2e9,
            "poisson_ratio": 0.3,
            "density": 2500.0,
            "work_of_adhesion": 1.0,
        },
        "packing": {"rows": 21, "columns": 1, "lattice": "chain", "first": "free", "last": "held"},
        "source": [{"rows": [3, 3], "force": "y", "signal": "burst", "frequency": 0.5, "amplitude": 0.02}],
        "absorb": {"rows": 12, "reflection": 0.2},
        "time": {"duration": 160.0},
    }
    scene = Scene.from_dict(tables)
    assert scene.quiet == ("last",)
    record = run(scene, tmp_path / "run")
    found = compare.compare(record)
    assert found.theory == "network"
    assert found.error["velocity"] < 1e-3  # the step of 0.05 leaves less
    # Waves have left at the quiet end, by way of the other one
    speeds = np.abs(record.velocity).max(axis=(1, 2))
    assert speeds[-1] < 0.2 * speeds.max()


def test_a_crystal_with_one_quiet_end_moves_as_its_network(tmp_path: Path) -> None:
    found = compare.compare(run(Scene.from_dict(SHAKEN), tmp_path / "run"))
    assert found.theory == "network"
    assert found.error["q"] < 2e-5  # the step of 0.02 leaves less
