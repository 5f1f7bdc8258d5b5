"""Monitors: what a scene may ask of them, what they record, and how their files fare in run folders."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ase.io
import numpy as np
import pytest

from granular_analysis.measure.norms import relative_error
from granular_analysis.theory.choice import traits_of
from granular_analysis.tools import compare
from granular_lmp import Record, Scene, build, run
from granular_lmp.accuracy.recorded import Recorded
from granular_lmp.cli import main
from granular_lmp.errors import LammpsError, RunFolderError, SceneError
from granular_lmp.lammps.binary_dump import binary_snapshots, continuation, mend_binary
from granular_lmp.lammps.checkpoints import SPEED
from granular_lmp.problem import prepare
from granular_lmp.rest.at_rest import echo_at
from granular_lmp.runs.adopt import adopt
from granular_lmp.runs.export import export
from granular_lmp.runs.launch import resume
from granular_lmp.runs.readouts import readout
from granular_lmp.scene.document import note
from tests.conftest import PAPER
from tests.manual import Measure, Mutant, verifies
from tests.pause import as_if_killed

PUSH: dict[str, Any] = {"spheres": [[6, 3]], "force": "y", "signal": "burst", "cycles": 2.0, "frequency": 1.0}
BEHIND: dict[str, Any] = {"name": "behind", "rows": [8, 9], "what": "flux"}
BESIDE: dict[str, Any] = {"name": "beside", "spheres": [[6, 4], [6, 3]], "what": "contacts"}
LINE: dict[str, Any] = {"name": "line", "rows": [4, 4]}
SHEET = PAPER.with_values(
    {"name": "sheet", "wave.form": "none", "wave.amplitude": 0.05, "wave.wavenumber": 1.0, "time.duration": 12.0}
    | {"packing.rows": 13, "packing.columns": 6, "source": [PUSH], "monitor": [BEHIND, BESIDE, LINE]}
    | {"time.allow_echo": True, "time.sample": 0.25}
)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return run(SHEET.with_values({"output.particles": 0.25}), tmp_path_factory.mktemp("monitors") / "run")


# --- scenes ----------------------------------------------------------------------------------------------------------


def test_a_scene_is_read_back_from_its_text() -> None:
    assert Scene.loads(SHEET.to_toml()) == SHEET
    assert SHEET.with_values({"monitor.3.rows": [2, 5]}).monitor[2].rows == (2, 5)
    assert "[[monitor]]" not in PAPER.to_toml()
    assert note("monitor.1.name", Scene) == "of its files, and of columns of a sweep"


def test_groups_of_lammps_bound_the_number_of_monitors() -> None:
    said = "monitor: 12 monitors beside 1 sources take 25 groups of LAMMPS, .*; must be at most 24"
    with pytest.raises(SceneError, match=said):
        prepare(SHEET.with_values({"monitor": [BEHIND | {"name": f"m{k}"} for k in range(12)]}))


def test_the_echo_at_a_monitor_is_said() -> None:
    def echo(**changes: Any) -> float:
        scene = PAPER.with_values({"packing.rows": 101, "time.allow_echo": True} | changes)
        return echo_at(scene, scene.monitor[0])

    near, far = ({"monitor": [{"name": "a", "rows": [row, row]}]} for row in (10, 50))
    assert echo(**near) < echo(**far) == PAPER.with_values({"packing.rows": 101, "time.allow_echo": True}).echo_time
    assert echo(**near, **{"packing.rows": 100, "packing.ends": "periodic"}) == np.inf

    def said(**changes: Any) -> bool:
        forced = SHEET.with_values({"time.duration": 4.0, "monitor.3.rows": [1, 1], "time.allow_echo": False} | changes)
        return any("monitor line: the echo of the walls may reach it" in each for each in prepare(forced).warnings())

    assert said()
    assert not said(**{"time.allow_echo": True})
    assert not said(**{"monitor.3.rows": [6, 6]})


# --- what is recorded ------------------------------------------------------------------------------------------------


def test_motion_is_that_of_the_snapshots(record: Record) -> None:
    snapshots = record.snapshots()
    for each in record.scene.monitor:
        found = record.monitor(each.name)
        np.testing.assert_array_equal(found.tau, snapshots.tau)
        for name in ("displacement", "velocity", "rotation", "spin"):
            np.testing.assert_array_equal(getattr(found, name), snapshots.stack(name)[:, found.spheres])
    assert abs(record.monitor("line").displacement).max() > 1e-3
    assert set(record.monitor("line").row) == {4}
    assert record.monitor("beside").column.tolist() == [3, 4]


@pytest.mark.parametrize(("spread", "rolls"), [(0.0, False), (1e-5, False), (1e-5, True)])
def test_contact_forces_and_torques_are_what_moves_a_sphere(
    spread: float, rolls: bool, record: Record, tmp_path: Path
) -> None:
    if spread:  # spheres that differ, one of them of twice the density
        heavy = {"disorder.radius": spread, "inclusion": [{"spheres": [[6, 4]], "density": 4400.0}]}
        stiff = record.scene.sphere.normal_stiffness
        rolling = {"effects.rolling_stiffness": stiff, "effects.rolling_friction": 10.0, "effects.rolling": rolls}
        record = run(record.scene.with_values(heavy | rolling), tmp_path / "run")
    beside = record.monitor("beside")
    contacts, scene = beside.contacts, record.scene
    sphere = scene.sphere
    number = int(beside.spheres[1])  # [6, 4], which nothing pushes from outside
    radius = beside.crystal.arrays["radius"][number]
    sign = np.where(contacts.j == number, 1.0, np.where(contacts.i == number, -1.0, 0.0))
    force = (sign[:, None] * contacts.force).sum(axis=1)
    lever = radius - contacts.overlap * sphere.overlap_ratio  # δ/2 in radii, as overlap_ratio is Δ0/2R
    torque = (sign * contacts.rolling - abs(sign) * contacts.shear * lever).sum(axis=1)
    # m/(k1 t0²): F = unit · a in k1 D0 and D0/t0²
    unit = 2 * (sphere.stiffness_ratio + 3) * radius**3 * (2.0 if spread else 1.0)
    rate = np.column_stack([beside.velocity[:, 1], 0.4 * radius**2 * beside.spin[:, 1]])
    slope = unit * np.gradient(rate, 0.25, axis=0)[1:-1]
    found = np.column_stack([force, torque])
    # The central difference over two samples, h = 1/4 each, is the mean of the acceleration, of which Simpson's rule
    # errs by h⁴/180 of the fourth derivative: 4e-4 at a frequency of 2, the top of all branches
    mean = (found[:-2] + 4 * found[1:-1] + found[2:]) / 6
    assert np.abs(slope - mean).max() < 1e-3 * np.abs(found).max()
    assert np.abs(1.05 * slope - mean).max() > 1e-2 * np.abs(found).max()
    assert rolls == bool(np.abs((sign * contacts.rolling).sum(axis=1)).max() > 0.05 * np.abs(torque).max())


def test_theories_ignore_monitors(tmp_path: Path, small: Scene) -> None:
    plain = run(small, tmp_path / "plain")
    seen = run(small.with_values({"monitor": [LINE | {"what": "flux"}]}), tmp_path / "seen")
    np.testing.assert_array_equal(seen.p, plain.p)
    assert traits_of(seen) == traits_of(plain)
    assert compare.compare(seen).error == compare.compare(plain).error


def test_a_monitor_of_another_kind_or_name_is_refused_by_name(record: Record) -> None:
    with pytest.raises(RunFolderError, match="monitor 'behid': no such monitor; did you mean 'behind'"):
        record.monitor("behid")
    with pytest.raises(RunFolderError, match='monitor line: what = "motion": holds no contacts'):
        _ = record.monitor("line").contacts
    with pytest.raises(RunFolderError, match='monitor beside: what = "contacts": holds no flux'):
        _ = record.monitor("beside").flux


# --- files -----------------------------------------------------------------------------------------------------------


def test_ase_reads_the_binary_motion(record: Record) -> None:
    assert record.folder is not None
    names = next(binary_snapshots(record.folder / "monitor.line.bin")).names
    frames = ase.io.read(record.folder / "monitor.line.bin", index=":", format="lammps-dump-binary", colnames=names)
    line = record.monitor("line")
    assert len(frames) == len(line.tau)
    radius = record.scene.sphere.radius * 1e9  # nm
    rest = line.crystal.positions[line.spheres]
    np.testing.assert_allclose(
        frames[0].positions[:, :2] - frames[0].positions[0, :2], radius * (rest - rest[0])[:, :2]
    )


def test_tables_hold_what_the_monitors_do_with_units(record: Record) -> None:
    pytest.importorskip("xarray")
    line, behind, beside = (record.monitor(name) for name in ("line", "behind", "beside"))
    motion, flux, contacts = (each.to_xarray() for each in (line, behind, beside))
    np.testing.assert_array_equal(motion.phi_t, line.spin)
    np.testing.assert_array_equal(flux.flux.sel(row=9), behind.flux[:, 1])
    np.testing.assert_array_equal(contacts.shear, beside.contacts.shear)
    np.testing.assert_array_equal(contacts.row_j, line.crystal.arrays["row"][beside.contacts.j])
    assert dict(contacts.sizes) == {"tau": len(beside.tau), "contact": len(beside.contacts.i)}
    units = [motion.phi_t, flux.flux, contacts.shear, contacts.overlap]
    assert [each.attrs["units"] for each in units] == ["D0/R rad/t0", "k1 D0^2/t0", "k1 D0", "Delta0"]
    watt = flux.attrs["force_N"] * flux.attrs["D0_m"] / flux.attrs["t0_s"]
    assert watt == pytest.approx(behind.watt, rel=1e-15)
    for each in (line, behind, beside):
        table = each.to_pandas()
        for name, values in each.columns().items():
            np.testing.assert_array_equal(table[name], values)


def test_csv_in_si_units_is_what_pandas_reads(record: Record, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    assert record.folder is not None
    sphere, d0 = record.scene.sphere, record.scene.displacement_amplitude
    tables = {}
    for each in record.scene.monitor:
        path = tmp_path / f"{each.name}.csv"
        assert main(["export", str(record.folder), "--monitor", each.name, "-o", str(path)]) == 0
        tables[each.name] = pandas.read_csv(path)
    line, behind, beside = (record.monitor(name) for name in ("line", "behind", "beside"))
    one = tables["line"].query("row == 4 and column == 2")
    assert list(one.columns) == ["t_s", "row", "column", *("u_m", "v_m", "theta_rad", "u_t_m_s", "v_t_m_s")] + [
        "theta_t_rad_s"
    ]
    # Factors of SI units, whose products round to 1e-16 each
    same = {"rtol": 1e-14, "atol": 0.0}
    np.testing.assert_allclose(one["t_s"], line.tau * sphere.time_scale, **same)
    np.testing.assert_allclose(one["v_m"], line.displacement[:, 2, 1] * d0, **same)
    np.testing.assert_allclose(one["theta_t_rad_s"] * sphere.radius * sphere.time_scale / d0, line.spin[:, 2], **same)
    flux = tables["behind"].pivot(index="t_s", columns="row", values="flux_W").to_numpy()
    watt = sphere.normal_stiffness * d0**2 / sphere.time_scale
    np.testing.assert_allclose(flux, behind.flux * watt, **same)
    touching = tables["beside"].query("row_i == 6 and column_i == 3 and row_j == 6 and column_j == 4")
    (pair,) = np.flatnonzero((beside.contacts.i == beside.spheres[0]) & (beside.contacts.j == beside.spheres[1]))
    force = sphere.normal_stiffness * d0
    np.testing.assert_allclose(touching["shear_N"], beside.contacts.shear[:, pair] * force, **same)
    with pytest.raises(RunFolderError, match=r"run\.nc: must end in one of \.csv for a monitor"):
        export(record, tmp_path / "run.nc", "line")


@pytest.mark.usefixtures("tried")
def test_check_names_monitors_with_their_size(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "sheet.toml"
    path.write_text(SHEET.to_toml(), encoding="utf-8")
    assert main(["check", str(path)]) == 0
    assert "monitor   behind: flux of 12 spheres, rows = [8, 9], 0." in capsys.readouterr().out
    assert main(["check", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["monitors"][2] == {
        "name": "line",
        "records": "motion of 6 spheres, rows = [4, 4]",
    }


def test_contacts_that_a_killed_run_did_not_write_are_unknown(record: Record, tmp_path: Path) -> None:
    assert record.folder is not None
    shutil.copytree(record.folder, tmp_path / "run")
    path = tmp_path / "run" / "monitor.behind.contacts"
    path.write_bytes(path.read_bytes()[:-50])
    as_if_killed(tmp_path / "run")
    whole, cut = record.monitor("behind"), Record.load(tmp_path / "run", unfinished=True).monitor("behind")
    np.testing.assert_array_equal(cut.flux[:-1], whole.flux[:-1])
    assert np.isnan(cut.flux[-1]).all()
    assert np.isfinite(cut.velocity).all()


def files_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("monitor.*"))}


def test_a_run_that_was_stopped_continues_to_the_same_bytes(
    tmp_path: Path, stop: Callable[[Scene, Path], None]
) -> None:
    scene = SHEET.with_values({"time.duration": 40.0, "output.checkpoint": 78 * 100 / SPEED / 60})

    for launcher in ("module", "lmp"):
        run(scene, tmp_path / launcher, launcher=launcher)
    stop(scene, tmp_path / "stopped")
    as_if_killed(tmp_path / "stopped")
    for path in (tmp_path / "stopped").glob("monitor.*"):  # while it wrote
        with path.open("ab") as stream:
            stream.write(path.read_bytes()[:100])
    unfinished = Record.load(tmp_path / "stopped", unfinished=True)
    assert 0 < len(unfinished.monitor("behind").flux) < 161
    assert resume(tmp_path / "stopped").info["status"] == "finished"
    whole, *others = map(files_of, (tmp_path / name for name in ("module", "lmp", "stopped")))
    assert list(whole) == [
        "monitor.behind.bin",
        "monitor.behind.contacts",
        "monitor.beside.bin",
        "monitor.beside.contacts",
        "monitor.line.bin",
    ]
    assert others == [whole, whole]


@pytest.mark.more
def test_two_ranks_record_the_same(record: Record, tmp_path: Path) -> None:
    two = run(record.scene, tmp_path / "two", ranks=2)
    for each in record.scene.monitor:
        found, expected = two.monitor(each.name), record.monitor(each.name)
        # Rounding of positions 6 µm from the origin, 1e-12 nm of D0 = 0.0125 nm, over 240 steps
        np.testing.assert_allclose(found.displacement, expected.displacement, atol=1e-8)
    # Forces: the same in k1 D0, times velocities of order 1
    np.testing.assert_allclose(two.monitor("behind").flux, record.monitor("behind").flux, atol=1e-7)


@verifies(
    "Two ranks, each with a part of every row: spheres of monitors out of their order",
    reference="analytic: the order of their numbers",
    tolerance=0.0,
    reason="a record is a table of spheres, so that none may be out of its place",
    mutant=Mutant("granular_lmp/lammps/monitors.py", "dump_modify  {name} sort id {", "dump_modify  {name} sort off {"),
)
def test_spheres_of_a_monitor_are_in_the_order_of_their_numbers_on_any_ranks(tmp_path: Path, measured: Measure) -> None:
    # Two ranks halve the longer side: each holds a part of every row
    wide = {"packing.columns": 24, "packing.rows": 7, "source.1.spheres": [[3, 3]], "time.duration": 1.0}
    lines = [{"name": "line", "rows": [2, 4]}, {"name": "pair", "spheres": [[3, 20], [3, 2]]}]
    scene = SHEET.with_values(wide | {"monitor": lines})
    two = run(scene, tmp_path / "two", ranks=2)
    for name in ("line", "pair"):
        for each in binary_snapshots(tmp_path / "two" / f"monitor.{name}.bin"):
            measured(np.count_nonzero(each.table[:, 0] != two.monitor(name).spheres + 1))


def test_adopted_and_forced_runs_take_their_monitors_along(record: Record, tmp_path: Path) -> None:
    assert record.folder is not None
    adopted = adopt(record.folder, tmp_path / "run")
    np.testing.assert_array_equal(adopted.monitor("behind").flux, record.monitor("behind").flux)
    (tmp_path / "run" / "monitor.mine.bin").write_text("not of the run")
    short = SHEET.with_values({"time.duration": 2.0, "monitor": []})
    run(short, tmp_path / "run", force=True)
    assert list(files_of(tmp_path / "run")) == ["monitor.mine.bin"]
    with pytest.raises(RunFolderError, match=r"monitor.line.bin: the file of a monitor of the scene is missing"):
        adopt(tmp_path / "run", tmp_path / "again", scene=short.with_values({"monitor": [LINE]}))


def test_a_tolerance_holds_for_monitors(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    scene = SHEET.with_values({"time.tolerance": 1e-2, "output.particles": 2.0})
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "run")]) == 0
    answer = Record.load(tmp_path / "run")
    finest = tmp_path / "run" / f"{round(0.25 / min(answer.info['extrapolated_from']))}_per_sample"
    # Errors of second order of a step that is at least eight times as small
    step = min(answer.info["extrapolated_from"]) / 8
    exact = run(SHEET.with_values({"time.timestep": step, "output.particles": 2.0}), tmp_path / "exact")
    truth, found, single = (Recorded() for _ in range(3))
    for one, record in ((truth, exact), (found, answer), (single, Record.load(finest))):
        one.add(record)
    (true,), (held,), (alone,) = truth.signals, found.signals, single.signals
    estimates = answer.info["errors_of_monitors"]
    assert {name for name in true if "." in name} >= set(estimates) >= {"behind.flux", "beside.normal", "line.v_t"}
    errors = {name: relative_error(held[name], true[name]) for name in estimates}
    assert max(errors.values()) <= max(estimates.values()) <= 1e-2
    # The estimate is that of three runs, of signals that are ten times better than the tolerance too
    assert all(errors[name] < 2 * estimates[name] for name in errors)
    assert max(relative_error(alone[name], true[name]) for name in estimates) > 2 * max(errors.values())
    # Files that a reader opens are those of the answer, and keep what does not move
    behind = answer.monitor("behind")
    assert behind.folder == tmp_path / "run"
    np.testing.assert_allclose(behind.tau, answer.tau)
    mine, theirs = (next(binary_snapshots(each / "monitor.line.bin")) for each in (tmp_path / "run", finest))
    assert mine.names == theirs.names
    np.testing.assert_array_equal(mine.table[:, :2], theirs.table[:, :2])
    worst = max(estimates, key=estimates.__getitem__)
    assert (
        f"for all other signals at most {estimates[worst]:.1e}, in {worst} (tolerance 0.01)" in capsys.readouterr().out
    )
    export(answer, tmp_path / "behind.csv", monitor="behind")
    flux = np.loadtxt(tmp_path / "behind.csv", delimiter=",", skiprows=1)[:, 2]
    np.testing.assert_allclose(flux, behind.flux.ravel() * behind.watt, rtol=1e-12)


def test_read_outs_of_a_run_to_a_tolerance_are_those_of_its_answer(tmp_path: Path) -> None:
    tone = {"rows": [6, 6], "force": "y", "ramp": 1.0, "frequency": 1.5}
    changes = {"source": [tone], "monitor": [LINE], "time.duration": 80.0, "packing.columns": 3, "time.tolerance": 1e-2}
    record = run(SHEET.with_values(changes), tmp_path / "run")
    assert record.info["monitors"]["line"] == readout(record.monitor("line"))
    assert record.info["monitors"]["line"]["v"]["1"][0] > 0
    assert Record.load(tmp_path / "run").info["monitors"] == record.info["monitors"]


def test_what_is_left_of_a_dump_is_mended_and_what_is_another_is_refused(record: Record, tmp_path: Path) -> None:
    assert record.folder is not None
    content = (record.folder / "monitor.line.bin").read_bytes()
    places = [(each.begin, each.end) for each in binary_snapshots(record.folder / "monitor.line.bin")]
    path = tmp_path / "monitor.line.bin"
    for cut in (0, 7, 60, 150, places[0][1] - 1):  # in the head, among the names, in the numbers
        path.write_bytes(content[: places[1][1] + cut])
        assert len(list(binary_snapshots(path))) == 2
    path.write_bytes(content + content[places[40][0] :])  # a continuation from record 40
    mend_binary(path)
    assert path.read_bytes() == content
    path.write_bytes(content[: places[45][1] + 20])
    continuation(path).write_bytes(content[places[40][0] :])
    mend_binary(path)
    assert path.read_bytes() == content
    assert not continuation(path).exists()
    path.write_bytes(content[places[3][0] : places[3][0] + 40] + b"x" * 200)
    assert not list(binary_snapshots(path))
    path.write_bytes(b"x" * 200)
    with pytest.raises(RunFolderError, match="not a binary dump of LAMMPS: at byte 0"):
        list(binary_snapshots(path))
    path.write_bytes(b"")
    assert not list(binary_snapshots(path))


def test_a_run_whose_monitor_lacks_records_fails(tmp_path: Path) -> None:
    deck = build(SHEET.with_values({"time.duration": 2.0}))
    for lost, gone in (("dump         monitor3", "undump monitor3"), ("dump_modify  contacts1", "undump contacts1")):
        cut = deck.edited(before={"run": gone})
        assert lost in deck.input_text
        with pytest.raises(LammpsError, match=r"monitor\.\w+\.\w+ lacks records"):
            run(cut, tmp_path / gone.replace(" ", "_"))


# --- scenes without a wave -------------------------------------------------------------------------------------------

NEAR: dict[str, Any] = {"name": "near", "rows": [2, 4], "what": "contacts"}
EVERYONE: dict[str, Any] = {"name": "everyone", "rows": [0, 7], "what": "contacts"}
THROUGH: dict[str, Any] = {"name": "through", "rows": [1, 5], "what": "flux"}
STRUCK = Scene.load("point_impact").with_values(
    {"packing.rows": 8, "packing.columns": 9, "striker.1.spheres": [[0, 4]], "time.duration": 12.0}
    | {"time.sample": 0.1, "time.timestep": 0.01, "monitor": [LINE, NEAR, THROUGH, EVERYONE]}
)


@pytest.fixture(scope="module")
def struck(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return run(STRUCK, tmp_path_factory.mktemp("struck") / "run")


def test_a_monitor_of_a_strike_records_what_the_run_does(struck: Record, tmp_path: Path) -> None:
    line = struck.monitor("line")
    for name in ("displacement", "velocity", "spin"):
        assert np.array_equal(getattr(line, name), getattr(struck, name)[:, line.spheres])
    export(struck, tmp_path / "line.csv", "line")
    table = np.genfromtxt(tmp_path / "line.csv", delimiter=",", names=True)
    speed = struck.velocity[:, line.spheres, 1].ravel() * struck.scale.velocity
    np.testing.assert_allclose(table["v_t_m_s"], speed, rtol=1e-12)
    # Nothing drives the crystal at one frequency
    assert set(struck.info["monitors"]["line"]) == {"why"}


def test_contacts_of_a_strike_follow_the_law_of_hertz(struck: Record) -> None:
    contacts = struck.monitor("near").contacts
    hertz = np.nan_to_num(np.maximum(contacts.overlap, 0.0)) ** 1.5  # in m v/t0, of overlaps in l
    assert contacts.normal.max() > 0.2
    np.testing.assert_allclose(contacts.normal, hertz, atol=1e-11)
    assert not contacts.shear.any()


def test_the_energy_beyond_a_row_came_through_it(struck: Record) -> None:
    through, contacts = struck.monitor("through"), struck.monitor("everyone").contacts
    row, kinetic = struck.problem.rest.atoms.arrays["row"], struck.kinetic_energy[-1]
    stored = 0.4 * np.nan_to_num(np.maximum(contacts.overlap[-1], 0.0)) ** 2.5
    came = np.trapezoid(through.flux, struck.tau, axis=0)
    for number, each in enumerate(through.rows):
        low, high = (pick(row[contacts.i], row[contacts.j]) for pick in (np.minimum, np.maximum))
        # A plane through the row cuts its spheres and the contacts between them in halves
        share = (low >= each) * np.where(high == each, 0.5, 1.0)
        beyond = kinetic[row > each].sum() + kinetic[row == each].sum() / 2 + (share * stored).sum()
        assert came[number] == pytest.approx(beyond, abs=2e-4)  # of the striker's; the step leaves 1e-4
    assert came[0] > came[-1] > 0.2


@pytest.mark.more
def test_a_tolerance_of_a_strike_holds_for_monitors(struck: Record, tmp_path: Path) -> None:
    record = run(STRUCK.with_values({"time.tolerance": 1e-2, "time.sample": 0.5}), tmp_path / "run")
    said = record.info["errors_of_monitors"]
    assert {"line.v", "near.normal", "through.flux"} < set(said)
    assert max(said.values()) <= 1e-2
    exact = struck.monitor("through").flux[::5]  # of 1e-4: 50 steps in t0
    assert np.abs(record.monitor("through").flux - exact).max() < 1e-2 * np.abs(exact).max()
