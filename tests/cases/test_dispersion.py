"""Dispersion of a kicked sheet: the peaks are where its waves are, and those of other spheres are elsewhere."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.dispersion import case as dispersion_figure
from cases.dispersion import density as dispersion
from granular_analysis.theory.contact import Contact
from granular_lmp import Scene, prepare, run
from granular_lmp.studies.kick import kicked
from tests.polarisations import modes

SMALL = Scene.load("tr_periodic").with_values(
    {"packing.rows": 12, "packing.columns": 12, "wave.amplitude": 0.01, "time.duration": 120.0, "time.sample": 1.5}
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run of a kicked sheet of 12 × 12 spheres."""
    folder = tmp_path_factory.mktemp("sheet") / "run"
    run(kicked(SMALL), folder)
    return folder


@pytest.fixture(scope="module")
def sheet(folder: Path) -> dispersion.Sheet:
    return dispersion.Sheet.load(folder)


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
    run(kicked(pressed), tmp_path / "run")
    sheet = dispersion.Sheet.load(tmp_path / "run")
    assert sheet.prestress == pytest.approx(0.999, abs=1e-4)
    right, others = distances(sheet)
    assert max(right.max(), others.max()) < 1
    # At an overlap of 2.5 % of the diameter the force at rest moves branches by a tenth of a resolution; measured 15
    assert np.median(right) < np.median(distances(replace(sheet, prestress=0.0))[0]) / 3


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
def test_the_script_draws(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert dispersion_figure.main([str(folder), "-o", str(tmp_path / "figure.png")]) == 0
    assert (tmp_path / "figure.png").stat().st_size > 0
    assert "upper branch" in capsys.readouterr().out


# Enough records to be read, of a sheet that the theory may not hold
SHORT = SMALL.with_values({"time.duration": 12.0})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"effects.viscosity": 1e-9}, "leaves out effects.damping"),
        ({"sphere.adhesion_law": "jkr"}, "leaves out sphere.adhesion_law"),
        ({"packing.lattice": "square", "packing.columns": 9}, "leaves out packing.lattice"),
        ({"monitor": [{"name": "line", "rows": [1, 2]}]}, "leaves out monitor"),
        ({"effects.rotation": False}, "needs a periodic sheet whose spheres turn"),
        ({"packing.ends": "fixed", "packing.rows": 13, "time.allow_echo": True}, "leaves out effects.walls"),
        ({"packing.columns": 4}, "columns a multiple of 3"),
        ({"time.sample": 1.7, "time.duration": 17.0}, r"time\.sample = 1\.7: must be below 1\.6\d+ tau"),
        ({"time.duration": 9.0}, "7 records; a spectrum needs at least 8"),
        ({"effects.sliding": False, "effects.friction": 1e-3}, "contacts slid"),
        ({"wave.amplitude": 2.0}, "contacts opened"),
    ],
)
def test_a_sheet_that_the_linear_theory_does_not_hold_is_refused(
    changes: dict[str, object], said: str, tmp_path: Path
) -> None:
    run(kicked(SHORT.with_values(changes)), tmp_path / "run")
    with pytest.raises(SystemExit, match=said):
        dispersion_figure.main([str(tmp_path / "run")])


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


@pytest.mark.parametrize(
    ("rows", "columns"), [(4, 3), *(pytest.param(*each, marks=pytest.mark.more) for each in ((6, 3), (4, 6)))]
)
@pytest.mark.usefixtures("drawn_once")
def test_the_smallest_sheets_that_are_run_are_analysed(rows: int, columns: int, tmp_path: Path) -> None:
    smallest = {"packing.rows": rows, "packing.columns": columns, "wave.wavenumber": np.pi / 2, "time.duration": 12.0}
    run(kicked(SMALL.with_values(smallest)), tmp_path / "run")
    assert dispersion_figure.main([str(tmp_path / "run"), "-o", str(tmp_path / "d.png")]) == 0


def test_other_folders_than_those_of_sheets_are_refused(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    for name, said in (("run", "holds no snapshots"), ("nowhere", "not a run folder")):
        with pytest.raises(SystemExit, match=said):
            dispersion_figure.main([str(tmp_path / name)])
    run(small.with_values({"output.particles": 1.0}), tmp_path / "seen")
    with pytest.raises(SystemExit, match="must be the run of granular-lmp kick"):
        dispersion_figure.main([str(tmp_path / "seen")])
