"""Energy flux through rows: of a plane wave, and in the balance of a driven, damped piece of crystal."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from granular_analysis.second_harmonic import ModeName, mode, ratios
from granular_lmp import Record, Scene, run
from granular_lmp.runs.monitors import MonitorRecord
from tests.conftest import PAPER
from tests.manual import Measure, Mutant, off, verifies

# --- a plane wave ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["L", "TR", "RT"])
@verifies(
    "Energy flux of L, TR, RT through rows of a run",
    reference="analytic: energy of the wave times its group velocity",
    tolerance=0.001,
    reason="velocity Verlet errs by (Ωh)²/24 = 4e-4 at Ω = 1.8",
    mutant=Mutant(
        "granular_lmp/runs/monitors.py",
        "(0.5 * up[:, None] * (of[:, None] == monitor.rows))",
        "(0.51 * up[:, None] * (of[:, None] == monitor.rows))",
    ),
)
def test_a_plane_wave_carries_its_energy_with_the_group_velocity(
    name: ModeName, tmp_path: Path, measured: Measure
) -> None:
    changes = {"wave.mode": name, "wave.wavenumber": np.pi / 4, "wave.amplitude": 1e-3, "time.duration": 20.0}
    monitor = {"name": "row", "rows": [0, 7], "what": "flux"}  # also through the rows at the face of the cell
    scene = Scene.load("tr_periodic").with_values({"packing.rows": 8, "time.sample": 0.2, "time.timestep": 0.05})
    record = run(scene.with_values(changes | {"monitor": [monitor]}), tmp_path / "run")
    row, sphere = record.monitor("row"), record.scene.sphere
    constants = ratios(sphere.poisson_ratio, overlap_ratio=sphere.overlap_ratio)
    below, wave, above = (mode(name, np.pi / 4 + step, constants) for step in (-1e-4, 0.0, 1e-4))
    speed = (above.frequency - below.frequency) / 2e-4  # rows per t0
    mass = 2 * (sphere.stiffness_ratio + 3)  # k1 t0²
    shape = wave.p**2 + wave.q**2 + 0.4 * wave.f**2
    expected = 3 * mass / 2 * wave.frequency**2 * shape * speed  # three columns, in k1 D0²/t0
    swing = 2 * wave.frequency * row.tau
    fits = np.column_stack([np.ones_like(swing), np.cos(swing), np.sin(swing)])
    (mean, *_), *_ = np.linalg.lstsq(fits, row.flux)
    # Velocity Verlet errs by (Ω h)²/24 of a frequency, 4e-4 at Ω = 1.8 and h = 0.05, and the flux by about that
    measured(off(mean / expected, np.ones_like(mean)))
    assert (expected < 0) == (name == "RT")  # whose energy runs against its crests


# --- the balance -----------------------------------------------------------------------------------------------------

PUSHED = PAPER.with_values(
    {"name": "pushed", "wave.form": "none", "wave.amplitude": 0.2, "wave.wavenumber": 1.0, "time.duration": 60.0}
    | {"packing.rows": 41, "packing.columns": 3, "packing.ends": "fixed", "time.allow_echo": True}
    | {"source": [{"rows": [20, 20], "force": "x", "amplitude": 12.0, "ramp": 10.0, "frequency": 0.497}]}
    | {"monitor": [{"name": "region", "rows": [14, 26], "what": "flux"}], "effects.viscosity": 2e-8}
    | {"time.sample": 0.25, "time.timestep": 0.05}
)


def ledger(record: Record) -> dict[str, np.ndarray]:
    """Return what the source has given to the spheres and contacts between two rows, and where it is, (T,) in k1 D0².

    The end rows and the contacts within them count half. `secant` is −∫ ½ k_S'(δ) ξ² dδ, which the secant law takes, as
    it has no potential.
    """
    scene, region = record.scene, record.monitor("region")
    sphere, a, contacts, tau = scene.sphere, scene.wave.amplitude, region.contacts, region.tau
    kappa, mass = sphere.stiffness_ratio, 2 * (sphere.stiffness_ratio + 3)
    dashpot = scene.effects.viscosity / (sphere.normal_stiffness * sphere.time_scale)
    first, last = region.rows[[0, -1]]

    def total(power: np.ndarray) -> np.ndarray:
        return cumulative_simpson(power, x=tau, initial=0.0)

    half = np.where((region.row == first) | (region.row == last), 0.5, 1.0)
    kinetic = mass / 2 * (np.sum(region.velocity**2, axis=-1) + 0.4 * region.spin**2) @ half
    row_i, row_j = (region.crystal.arrays["row"][end] for end in (contacts.i, contacts.j))
    inside = (np.minimum(row_i, row_j) >= first) & (np.maximum(row_i, row_j) <= last)
    share = np.where(inside, np.where((row_i == row_j) & ((row_i == first) | (row_i == last)), 0.5, 1.0), 0.0)
    i, j = (np.searchsorted(region.spheres, end).clip(max=len(region.spheres) - 1) for end in (contacts.i, contacts.j))
    normal = contacts.vector / np.linalg.norm(contacts.vector, axis=-1, keepdims=True)
    tangent = np.stack([-normal[..., 1], normal[..., 0]], axis=-1)
    apart = region.velocity[:, j] - region.velocity[:, i]
    parting = np.sum(apart * normal, axis=-1)
    slip = np.sum(apart * tangent, axis=-1) - region.spin[:, i] - region.spin[:, j]
    overlap, shear = contacts.overlap, contacts.shear + dashpot * slip  # the force of the spring alone
    stiffness = kappa * np.sqrt(overlap)
    elastic = (4 / 15 * overlap**2.5 - 2 / 3 * overlap) / a**2 + shear**2 / (2 * stiffness)
    if scene.effects.rolling_stiffness:  # the arm of a roll is R/2
        elastic += (2 * contacts.rolling) ** 2 / (2 * scene.effects.rolling_stiffness / sphere.normal_stiffness)
    energy = kinetic + elastic @ share
    source = scene.source[0]
    rise = np.clip(tau / source.ramp, 0, 1)
    push = source.amplitude * rise**3 * (10 - 15 * rise + 6 * rise**2) * np.cos(0.497 * tau)
    return {
        "work": total(push * region.velocity[:, region.row == 20, 0].sum(axis=1)),
        "flux": total(region.flux[:, -1] - region.flux[:, 0]),
        "energy": energy - energy[0],
        "dissipation": total(dashpot * (parting**2 + slip**2) @ share),
        "secant": total((shear**2 / (4 * stiffness * overlap) * a * parting) @ share),
    }


def unbalanced(ledger: Mapping[str, np.ndarray]) -> float:
    """Return the largest difference of what was given and what is there, as a share of what was given."""
    given, *spent = (ledger[name] for name in ("work", "flux", "energy", "dissipation", "secant"))
    return float(np.abs(given - sum(spent)).max() / np.abs(given).max())


ROLLING = {"effects.rolling_stiffness": PAPER.sphere.normal_stiffness, "effects.rolling_friction": 10.0}


@pytest.fixture(scope="module")
def rolling(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return run(PUSHED.with_values(ROLLING), tmp_path_factory.mktemp("flux") / "rolling")


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    return ledger(run(PUSHED, tmp_path_factory.mktemp("flux") / "run"))


def test_what_a_source_gives_is_in_flux_energy_dissipation_and_the_work_of_the_shear_law(
    found: dict[str, np.ndarray],
) -> None:
    # LAMMPS's dashpots see velocities of half a step ago: first order in the step of 0.05, 1e-4 here. The rest is the
    # second order of the step, (Ω h)²/24 = 3e-5
    assert unbalanced(found) < 1e-3


@pytest.mark.parametrize("term", ["flux", "energy", "dissipation", "secant"])
def test_without_one_of_the_terms_the_balance_fails(term: str, found: dict[str, np.ndarray]) -> None:
    assert unbalanced(found | {term: np.zeros_like(found[term])}) > 1e-2


def test_two_percent_more_flux_are_seen(found: dict[str, np.ndarray]) -> None:
    assert unbalanced(found | {"flux": 1.02 * found["flux"]}) > 5e-3


def test_contacts_that_resist_rolling_carry_energy_by_its_torque(
    rolling: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert unbalanced(ledger(rolling)) < 1e-3  # as above
    region = rolling.monitor("region")
    free = replace(region.contacts, rolling=np.zeros_like(region.contacts.rolling))
    monkeypatch.setattr(MonitorRecord, "contacts", free)
    assert unbalanced(ledger(rolling)) > 1e-2


def test_contacts_give_no_power_to_spheres_that_turn_as_one_body(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their arms R − δ/2 add up to the distance of the spheres, so that the torque of a pair is zero."""
    monitor = [{"name": "region", "rows": [18, 22], "what": "contacts"}]
    record = run(PUSHED.with_values({"monitor": monitor, "time.duration": 20.0}), tmp_path / "run")
    region = record.monitor("region")
    scale = record.scene.displacement_amplitude / record.scene.sphere.radius
    places = region.crystal.positions[region.spheres, :2] + scale * region.displacement
    turning = np.stack([-places[..., 1], places[..., 0]], axis=-1)
    contacts, spin = region.contacts, np.ones_like(region.spin)
    monkeypatch.setattr(MonitorRecord, "velocity", property(lambda _: turning))
    monkeypatch.setattr(MonitorRecord, "spin", property(lambda _: spin))
    near = np.abs(np.diff(region.crystal.positions[[contacts.i, contacts.j], 0], axis=0)[0]) < 3  # no image
    near &= np.isin(contacts.i, region.spheres) & np.isin(contacts.j, region.spheres)
    one, other = (region.power(end)[:, near] for end in "ij")
    sheared = np.abs(contacts.force).max()
    assert near.sum() > 20
    assert np.abs(one + other).max() < 1e-9 * sheared  # places of the dump have ten digits
