"""Dispersion of a kicked sheet: the peaks are where its waves are, and those of other spheres are elsewhere."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.dispersion import case as dispersion_figure
from cases.dispersion import density as dispersion
from granular_analysis.theory.contact import Contact
from granular_lmp import Scene, load, prepare, resume, run
from granular_lmp.errors import EffectError, RunFolderError, SceneError
from granular_lmp.lammps.checkpoints import SPEED
from granular_lmp.studies.kick import kicked, run_kicked
from tests.polarisations import modes

SMALL = Scene.load("tr_periodic").with_values(
    {"packing.rows": 12, "packing.columns": 12, "wave.amplitude": 0.01, "time.duration": 120.0, "time.sample": 1.5}
)


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> dispersion.Sheet:
    """A sheet of 12 × 12 spheres in LAMMPS."""
    return dispersion.Sheet.load(run_kicked(SMALL, tmp_path_factory.mktemp("sheet") / "run"))


def distances(sheet: dispersion.Sheet) -> tuple[np.ndarray, np.ndarray]:
    branches, others = dispersion.misses(sheet, dispersion.zone_path(sheet.box)[0])
    return branches[~np.isnan(branches)], others


def test_every_peak_of_lammps_is_a_branch_and_every_branch_has_a_peak(sheet: dispersion.Sheet) -> None:
    branches, others = distances(sheet)
    # Two peaks that overlap shift each other by a part of the resolution; the median is far below
    assert max(branches.max(), others.max()) < 1
    assert np.median(branches) < 0.05
    assert branches.size > 30


def test_the_branches_of_other_spheres_are_not_there(sheet: dispersion.Sheet) -> None:
    # ν = 0.3 in place of 0.17 moves the upper branch by up to 0.07 rad per τ, at a resolution of 0.05; ν = −0.5 by 0.2
    right, _ = distances(sheet)
    wrong, _ = distances(replace(sheet, poisson_ratio=0.3))
    assert np.median(wrong) > 5 * np.median(right)
    assert np.median(distances(replace(sheet, poisson_ratio=-0.5))[0]) > 1


def test_compression_turns_the_branches_of_a_sheet_as_in_theory(tmp_path: Path) -> None:
    pressed = SMALL.with_values({"packing.contact_force": 1e-4})
    sheet = dispersion.Sheet.load(run_kicked(pressed, tmp_path / "run"))
    assert sheet.prestress == pytest.approx(0.999, abs=1e-4)
    right, others = distances(sheet)
    assert max(right.max(), others.max()) < 1
    # At an overlap of 2.5 % of the diameter the force at rest moves branches by a tenth of a resolution; measured 15
    assert np.median(right) < np.median(distances(replace(sheet, prestress=0.0))[0]) / 3


def test_a_sheet_that_adheres_of_an_earlier_version_is_read(sheet: dispersion.Sheet, tmp_path: Path) -> None:
    fields = {name: getattr(sheet, name) for name in dispersion.Sheet.__dataclass_fields__} | {"contact_force": 0.0}
    np.savez(tmp_path / "sheet.npz", **{name: value for name, value in fields.items() if name != "prestress"})
    assert dispersion.Sheet.load(tmp_path).prestress == 0.0


def test_peaks_of_synthetic_waves_are_found() -> None:
    wavevector = np.array([[2 * np.pi / 12, 2 * np.pi / (6 * np.sqrt(3))]])
    frequencies, shapes = modes(wavevector[0], Contact(0.17))
    tau = np.arange(0, 300, 1.5)
    x, y = np.meshgrid(np.arange(12.0), np.arange(12) * np.sqrt(3) / 2)
    position = np.column_stack([x.ravel(), y.ravel()])
    angle = (position @ wavevector[0])[None, :, None] - tau[:, None, None] * frequencies
    velocity = np.real(np.exp(1j * angle) @ shapes)
    sheet = dispersion.Sheet(tau, velocity, position, np.array([12.0, 6 * np.sqrt(3)]), 0.17, 0.0)
    found = dispersion.peaks(*(part if part.ndim == 1 else part[0] for part in dispersion.density(sheet, wavevector)))
    # The parabola is right to a hundredth of the resolution; side lobes of others add a little
    assert found == pytest.approx(frequencies, abs=0.03 * sheet.resolution)


def test_the_path_goes_from_corner_to_corner() -> None:
    path, corners = dispersion.zone_path(np.array([12.0, 6 * np.sqrt(3)]))
    gamma, m, k = (0, 0), (0, 2 * np.pi / np.sqrt(3)), (4 * np.pi / 3, 0)
    assert path[corners] == pytest.approx(np.array([gamma, m, k, gamma]))
    # M–K ends a step before the other K
    assert path[corners[2] - 1] == pytest.approx([2 * np.pi / 3 - 2 * np.pi / 12, m[1]])


@pytest.mark.parametrize("box", [(10.0, 6 * np.sqrt(3)), (12.0, 6.5 * np.sqrt(3))])
def test_a_sheet_without_the_corners_is_refused(box: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="rows must be even and columns a multiple of 3"):
        dispersion.zone_path(np.array(box))


@pytest.mark.usefixtures("drawn_once")
def test_the_script_draws(sheet: dispersion.Sheet, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fields = {name: getattr(sheet, name) for name in dispersion.Sheet.__dataclass_fields__}
    np.savez(tmp_path / "sheet.npz", **fields)
    assert dispersion_figure.main([str(tmp_path / "sheet.npz"), "-o", str(tmp_path / "figure.png")]) == 0
    assert (tmp_path / "figure.png").stat().st_size > 0
    assert "upper branch" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"contact_force": 1e-6, "prestress": None}, "prestress is not a file"),  # of an earlier version
        ({"effects": ["shear", "rotation", "damping", "rolling"]}, "leaves out effects.damping, effects.rolling"),
        ({"effects": None}, "effects is not a file"),
    ],
)
def test_a_sheet_that_the_linear_theory_does_not_hold_is_refused(
    changes: dict[str, object], said: str, sheet: dispersion.Sheet, tmp_path: Path
) -> None:
    fields = {name: getattr(sheet, name) for name in dispersion.Sheet.__dataclass_fields__} | changes
    np.savez(tmp_path / "sheet.npz", **{name: value for name, value in fields.items() if value is not None})
    with pytest.raises(SystemExit, match=said):
        dispersion_figure.main([str(tmp_path / "sheet.npz")])


# ---------------------------------------------------------------- the kick


def test_a_kick_changes_nothing_but_the_wave() -> None:
    other, unit = kicked(SMALL, seed=3), SMALL.displacement_amplitude / SMALL.sphere.time_scale
    state = prepare(other).rest.state
    moving = [3, 4, 8]  # vx, vy and the spin about z
    velocity = state[:, moving] / unit * [1, 1, SMALL.sphere.radius]
    assert not np.delete(state, moving, axis=1).any()
    assert np.abs(velocity[:, :2].mean(axis=0)).max() < 1e-15  # rounding
    assert (np.ptp(velocity, axis=0) <= 1).all()
    assert velocity.std(axis=0) == pytest.approx(np.full(3, 1 / np.sqrt(12)), rel=0.1)  # uniform, of 144 spheres
    assert np.array_equal(prepare(kicked(SMALL, seed=3)).rest.state, state)
    assert not np.array_equal(prepare(kicked(SMALL, seed=4)).rest.state, state)
    changed = {key for key, value in other.departures().items() if value != prepare(SMALL).scene.departures().get(key)}
    assert changed == {"wave.form", "start.noise", "start.seed", "output.particles", "time.allow_echo"}


def test_a_kicked_sheet_is_a_run(tmp_path: Path) -> None:
    path = run_kicked(SMALL.with_values({"time.duration": 12.0}), tmp_path / "run", 3)
    with np.load(path) as sheet:
        first = run(Scene.load(tmp_path / "run"), tmp_path / "again").snapshots()[-1]
        assert np.array_equal(sheet["velocity"][-1], np.column_stack([first.velocity, first.spin]))
    assert load(path.parent).scene.start.seed == 3


OFTEN = SMALL.with_values({"time.duration": 60.0, "output.checkpoint": SMALL.shape.spheres * 200 / SPEED / 60})


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A kicked sheet that nobody stopped."""
    return run_kicked(OFTEN, tmp_path_factory.mktemp("kicked") / "whole", 3)


@pytest.mark.parametrize("by", ["kick", "resume"])
def test_a_kick_that_was_stopped_is_continued(by: str, whole: Path, tmp_path: Path, stop: Callable[..., None]) -> None:
    stop(kicked(OFTEN, 3), tmp_path / "cut")
    if by == "resume":
        resume(tmp_path / "cut")
    cut = run_kicked(OFTEN, tmp_path / "cut", 3)
    with np.load(cut) as found, np.load(whole) as expected:
        assert np.array_equal(found["velocity"], expected["velocity"])
    with pytest.raises(RunFolderError, match="is there already"):
        run_kicked(OFTEN, tmp_path / "cut", 3)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"effects.sliding": False, "effects.friction": 1e-3}, "contacts slid"),
        ({"wave.amplitude": 2.0}, "contacts opened"),
    ],
)
def test_a_kick_that_is_too_hard_is_refused(changes: dict[str, object], said: str, tmp_path: Path) -> None:
    with pytest.raises(EffectError, match=said):
        run_kicked(SMALL.with_values({"time.duration": 12.0} | changes), tmp_path / "run")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"packing.columns": 4}, r"packing\.columns = 4: must be a multiple of 3"),
        (
            {"packing.ends": "fixed", "packing.rows": 13, "time.allow_echo": True},
            r'packing\.ends = .fixed.: must be "periodic"',
        ),
        ({"wave.form": "driven", "packing.ends": "fixed"}, r"must be"),
        ({"wave.mode": "L"}, "must be"),
        ({"effects.viscosity": 1e-9}, r"effects\.damping is on: must be off for a sheet that is kicked"),
        ({"effects.rotation": False}, r"effects\.rotation is off: must be on for a sheet that is kicked"),
        ({"time.sample": 1.7}, r"time\.sample = 1\.7: must be below 1\.6\d+ tau"),
        ({"time.duration": 10.6}, r"time\.duration = 10\.6: must be at least 8 x time\.sample = 12\.0 tau"),
    ],
)
def test_a_scene_that_cannot_be_kicked_or_analysed_is_not_run(
    changes: dict[str, object], said: str, tmp_path: Path
) -> None:
    with pytest.raises(SceneError, match=said):
        run_kicked(SMALL.with_values(changes), tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("rows", "columns"), [(4, 3), *(pytest.param(*each, marks=pytest.mark.more) for each in ((6, 3), (4, 6)))]
)
@pytest.mark.usefixtures("drawn_once")
def test_the_smallest_sheets_that_are_run_are_analysed(rows: int, columns: int, tmp_path: Path) -> None:
    smallest = {"packing.rows": rows, "packing.columns": columns, "wave.wavenumber": np.pi / 2, "time.duration": 12.0}
    run_kicked(SMALL.with_values(smallest), tmp_path / "run")
    assert dispersion_figure.main([str(tmp_path / "run"), "-o", str(tmp_path / "d.png")]) == 0


def test_other_files_than_sheets_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "other.npz", tau=np.ones(3))
    np.save(tmp_path / "array.npy", np.ones(3))
    for name in ("text.npz", "other.npz", "array.npy", "nowhere", ""):
        with pytest.raises(SystemExit, match="not the sheet of granular-lmp kick"):
            dispersion_figure.main([str(tmp_path / name)])
