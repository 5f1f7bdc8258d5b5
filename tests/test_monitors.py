"""Monitors: what a scene may ask of them, what they record, and how their files fare in run folders."""

from pathlib import Path
from typing import Any

import ase.io
import numpy as np
import pytest

from analysis import compare
from analysis.theory.choice import traits_of
from granular_lmp import Record, Scene, run
from granular_lmp.errors import RunFolderError, SceneError
from granular_lmp.lammps.binary_dump import binary_snapshots
from granular_lmp.problem import prepare
from granular_lmp.scene.scene import note
from granular_lmp.studies.kick import run_kicked
from tests.conftest import PAPER

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
    assert note("monitor.1.name") == "of its files, and of columns of a sweep"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"monitor": [{"rows": [4, 4]}]}, "monitor 1: name: missing key; must be a name of at most 40 ASCII letters"),
        ({"monitor.1.name": "a b"}, r"monitor\.1\.name = 'a b': must be a name of at most 40 ASCII letters, digits"),
        ({"monitor.1.name": "a/../b"}, "must be a name of at most 40"),
        ({"monitor.1.name": "LINE"}, "monitor 3: name = 'line': is that of monitor 1 too"),
        ({"monitor.1.what": "heat"}, r'what = \'heat\': must be one of "motion", "contacts", "flux"'),
        ({"monitor.1.spheres": [[1, 1]]}, "monitor behind: rows and spheres given: must be either rows or spheres"),
        ({"monitor": [{"name": "a"}]}, "monitor a: neither given: must be either rows or spheres"),
        ({"monitor.3.rows": [4, 13]}, r"monitor line: rows = \[4, 13\]: must be \[first, last\], from 0 to 12"),
        ({"monitor.2.spheres": [[1, 6]]}, r"monitor beside: sphere \[1, 6\]: must be .* to \[12, 5\]"),
        ({"monitor.2.what": "flux"}, r"monitor beside: spheres = .*: must be rows with what = \"flux\""),
        ({"monitor.1.sample": 2.0}, r"monitor\.1\.sample: unknown key"),
        ({"packing.rows": "auto", "wave.form": "running", "source": []}, r"packing\.rows = 'auto': must be a number"),
        (
            {"packing.columns": "auto", "wave.form": "running", "source": []},
            r"packing\.columns = 'auto': must be a number where a monitor has single spheres",
        ),
        ({"inclusion": [{"spheres": [[6, 4]], "vacancy": True}]}, r"monitor beside: sphere \[6, 4\]: is a vacancy"),
        (
            {"effects.rolling_stiffness": 1.0, "effects.rolling_friction": 1e3},
            r'monitor behind: what = "flux": must be "motion" with effects\.rolling',
        ),
        (
            {"monitor": [BEHIND | {"name": f"m{k}"} for k in range(12)]},
            "monitor: 12 monitors beside 1 sources take 25 groups of LAMMPS, .*; must be at most 24",
        ),
        ({"detector": []}, r"detector: unknown key; \[\[monitor\]\] declares what is recorded"),
    ],
)
def test_what_cannot_be_recorded_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        prepare(SHEET.with_values(changes))


def test_the_echo_at_a_monitor_is_said() -> None:
    def echo(**changes: Any) -> float:
        scene = PAPER.with_values({"packing.rows": 101, "time.allow_echo": True} | changes)
        return scene.echo_at(scene.monitor[0])

    near, far = ({"monitor": [{"name": "a", "rows": [row, row]}]} for row in (10, 50))
    assert echo(**near) < echo(**far) == PAPER.with_values({"packing.rows": 101, "time.allow_echo": True}).echo_time
    assert echo(**near, **{"packing.rows": 100, "packing.ends": "periodic"}) == np.inf
    assert any("monitor line: the echo of the walls may reach it at tau = " in each for each in SHEET.remarks())


def test_a_sheet_that_is_kicked_has_no_monitors(tmp_path: Path) -> None:
    scene = Scene.load("tr_periodic").with_values({"packing.columns": 6, "monitor": [LINE]})
    with pytest.raises(SceneError, match="monitor: must be left out for a sheet that is kicked"):
        run_kicked(scene, tmp_path / "run")


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


def test_contact_forces_and_torques_are_what_moves_a_sphere(record: Record) -> None:
    beside = record.monitor("beside")
    contacts, scene = beside.contacts, record.scene
    sphere = scene.sphere
    number = int(beside.spheres[1])  # [6, 4], which nothing pushes from outside
    sign = np.where(contacts.j == number, 1.0, np.where(contacts.i == number, -1.0, 0.0))
    force = (sign[:, None] * contacts.force).sum(axis=1)
    torque = -(abs(sign) * contacts.shear * (1 - contacts.overlap * sphere.overlap_ratio)).sum(axis=1)
    unit = 2 * (sphere.stiffness_ratio + 3)  # m/(k1 t0²): F = unit · a in k1 D0 and D0/t0²
    rate = np.column_stack([beside.velocity[:, 1], 0.4 * beside.spin[:, 1]])
    slope = unit * np.gradient(rate, 0.25, axis=0)[1:-1]
    found = np.column_stack([force, torque])
    # The central difference over two samples, h = 1/4 each, is the mean of the acceleration, of which Simpson's rule
    # errs by h⁴/180 of the fourth derivative: 4e-4 at a frequency of 2, the top of all branches
    mean = (found[:-2] + 4 * found[1:-1] + found[2:]) / 6
    assert np.abs(slope - mean).max() < 1e-3 * np.abs(found).max()
    assert np.abs(1.05 * slope - mean).max() > 1e-2 * np.abs(found).max()


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
