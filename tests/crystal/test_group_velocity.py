"""Fronts: group velocities of one frequency in all directions, and where energy is in LAMMPS."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from granular_lmp import Record, Scene, run
from granular_lmp.crystal.lattices import lattice_constant, unit_lattice
from granular_lmp.crystal.mode import Physics
from granular_lmp.crystal.modes import bloch_mode, bloch_modes
from granular_lmp.crystal.wavevector import ROW_SPACING, WaveVector
from granular_lmp.crystal.zone import fronts
from granular_lmp.errors import ViewError
from granular_lmp.plot import crystal
from granular_lmp.plot.view import view
from granular_lmp.runs.snapshots import Snapshots
from tests.conftest import members
from tests.crystal.test_sphere import SILICA
from tests.manual import Measure, Mutant, verifies

LATTICE = unit_lattice(SILICA)
ROW = ROW_SPACING * lattice_constant(SILICA)  # radii
BURST = 2 * np.pi * 4 / 1.4  # τ: it is over at 18
RING = Scene.load("point_source").with_values(
    {"packing.rows": 35, "packing.columns": 36, "time.duration": 30.0, "output.particles": 0.5, "time.sample": 0.5}
    | {"time.allow_echo": True, "name": "ring"}
    | {"source": [{"spheres": [[17, 18]], "force": "torque", "signal": "burst", "frequency": 1.4, "cycles": 4.0}]}
)


@cache
def fronts_at(frequency: float) -> dict[str, np.ndarray]:
    """Return the fronts of one frequency, found once."""
    return fronts(LATTICE, SILICA, frequency)


@pytest.fixture(scope="module")
def ring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fronts") / "run"
    run(RING, folder)
    return folder


@pytest.mark.parametrize(("name", "xi"), members([("L", 0.9), ("TR", 1.3), ("RT", 0.8)], ("L", 0.9)))
def test_along_y_the_front_is_that_of_the_dispersion(name: str, xi: float) -> None:
    ahead, here, behind = (
        bloch_mode(LATTICE, SILICA, WaveVector.of(each), name).frequency for each in (xi + 1e-4, xi, xi - 1e-4)
    )
    speed = abs(ahead - behind) / 2e-4 * ROW
    # The direction of k nearest to y is half a degree off, and |k| is interpolated
    velocity = fronts_at(here)[name]
    nearest = velocity[np.argmin(np.abs(velocity[:, 0]) - 10 * (velocity[:, 1] > 0))]
    assert np.hypot(*nearest) == pytest.approx(speed, rel=3e-3)


@verifies(
    "Fronts of one frequency in all directions, long waves",
    reference="analytic: the speeds of sound of L and TR",
    tolerance=0.002,
    reason="dispersion is of second order in ξ = 0.06 to 0.09",
    mutant=Mutant("granular_lmp/crystal/zone.py", "/ (2 * _STEP)", "/ (2.01 * _STEP)"),
)
def test_long_waves_have_round_fronts_at_the_speeds_of_sound(measured: Measure) -> None:
    found = fronts_at(0.03)
    assert set(found) == {"L", "TR"}
    for name, velocity in found.items():
        sound = bloch_mode(LATTICE, SILICA, WaveVector.of(1e-3), name).frequency / 1e-3 * ROW
        measured(np.abs(np.hypot(*velocity.T) / sound - 1).max())


def test_fronts_have_the_symmetry_of_the_crystal() -> None:
    velocity = fronts_at(0.9)["TR"]
    angle = np.radians(60)
    turned = velocity @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    np.testing.assert_allclose(np.roll(turned, 60, axis=0), velocity, atol=1e-4)  # central differences: 1e-16/1e-4
    assert np.ptp(np.hypot(*velocity.T)) > 0.1  # no circle


def test_without_rotation_there_is_no_rt() -> None:
    assert "RT" in fronts_at(1.4)
    assert not fronts(LATTICE, SILICA, 1.4, Physics(rotation=False))


def test_in_lammps_the_energy_of_a_turned_sphere_is_on_the_front_of_rt(ring: Path) -> None:
    snapshots = Snapshots.load(ring)
    distance = np.hypot(*(snapshots.rest - snapshots.rest[17 * 36 + 18]).T)
    late = snapshots.tau > BURST
    radii = [np.average(distance, weights=snapshots[int(place)].energy) for place in np.flatnonzero(late)]
    speed = np.polyfit(snapshots.tau[late], radii, 1)[0]
    # Each mode gets energy as the square of the spectrum of the burst at its frequency, and of its rotation
    share = (np.arange(1600) + 0.5) / 1600
    k = 2 * np.pi * np.column_stack([share, (2 * (share * 987 % 1) - share) / np.sqrt(3)]) / lattice_constant(SILICA)
    frequency, shape = bloch_modes(LATTICE, SILICA, k)
    tau = np.linspace(0, BURST, 400)
    signal = np.sin(np.pi * tau / BURST) ** 2 * np.cos(1.4 * tau)
    weight = np.abs(np.exp(1j * frequency[..., None] * tau) @ signal) ** 2
    weight *= shape[..., 5] ** 2 / (shape[..., 0] ** 2 + shape[..., 1] ** 2 + 0.4 * shape[..., 5] ** 2)
    slopes = [
        (bloch_modes(LATTICE, SILICA, k + each)[0] - bloch_modes(LATTICE, SILICA, k - each)[0]) / 2e-4
        for each in 1e-4 * np.eye(2)
    ]
    mean = np.average(np.hypot(*slopes), weights=weight)
    # The kinetic half of the energy swings, and the ring is as wide as a burst: a few per cent over 12 τ
    assert speed == pytest.approx(mean, rel=0.03)
    # The burst holds slower waves at both ends of its spectrum, from 0.7 to 2.1
    assert mean == pytest.approx(np.hypot(*fronts_at(1.4)["RT"].T).mean(), rel=0.15)


def test_lines_stand_where_the_group_velocity_says(ring: Path) -> None:
    figure = crystal.run_figure(Record.load(ring), Snapshots.load(ring), tau=25.0, fronts=True)
    axes = next(axes for axes in figure.axes if axes.get_ylabel() == "row")
    (line,) = [line for line in axes.lines if line.get_label() == "RT, $\\Omega$ = 1.4"]
    start = Snapshots.load(ring).rest[17 * 36 + 18]
    middle = BURST / 2
    expected = start + fronts_at(1.4)["RT"] * (25 - middle)
    np.testing.assert_allclose(line.get_xydata()[:-1], expected, rtol=1e-9)  # the same numbers
    early = crystal.run_figure(Record.load(ring), Snapshots.load(ring), tau=5.0, fronts=True)
    axes = next(axes for axes in early.axes if axes.get_ylabel() == "row")
    (line,) = [line for line in axes.lines if line.get_label() == "RT, $\\Omega$ = 1.4"]
    assert not line.get_visible()


def test_a_front_of_a_source_that_is_not_recorded_is_refused(tmp_path: Path) -> None:
    source = {"spheres": [[6, 3]], "force": "y", "signal": "burst", "frequency": 1.0}
    packing = {"lattice": "hexagonal", "rows": 13, "columns": 7}
    tables = {"packing": packing, "time": {"duration": 2.0}, "source": [source], "output": {"spheres": [[3, 3]]}}
    run(Scene.from_dict({"sphere": RING.to_dict()["sphere"], **tables}), tmp_path / "run")
    with pytest.raises(
        ViewError, match=r"the source on sphere \[6, 3\] of .* is not recorded; add the sphere to output"
    ):
        view(tmp_path / "run", tmp_path / "picture.png", fronts=True)


def test_waves_without_fronts_are_refused(ring: Path, tmp_path: Path) -> None:
    tone = {"source.1.signal": "tone", "source.1.cycles": 5.0, "source.1.ramp": 5.0}
    short = RING.with_values({"time.duration": 1.0})
    for number, (changes, message) in enumerate(
        [
            (tone, 'must have signal = "burst"'),
            ({"source.1.spheres": [[17, each] for each in range(9)]}, "list 1 to 4 spheres"),
            ({"inclusion": [{"spheres": [[3, 3]], "density": 3000.0}]}, "must be a perfect hexagonal sheet"),
        ]
    ):
        run(short.with_values(changes), tmp_path / str(number))
        with pytest.raises(ViewError, match=message):
            view(tmp_path / str(number), tmp_path / "picture.png", fronts=True)
    with pytest.raises(ViewError, match="--fronts: cannot be used for a crystal at rest"):
        view(ring, tmp_path / "picture.png", fronts=True, at_rest=True)
