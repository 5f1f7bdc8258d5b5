"""Scattering at rows that differ: closed form, conservation, reciprocity, and the network of spheres in time."""

from dataclasses import replace

import numpy as np
import pytest

from granular_analysis.second_harmonic import mode as mode_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.network import Material, Network
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import forces, start
from granular_analysis.theory.rows import heavy_rows, rows_of
from granular_analysis.theory.transfer import scattering
from granular_lmp.crystal.sphere import Sphere
from tests.conftest import members

SILICA = Sphere(radius=5e-7, youngs_modulus=73e9, poisson_ratio=0.17, work_of_adhesion=0.063, density=2200.0)
CONTACT = Contact(0.17, overlap_ratio=SILICA.overlap_ratio)
# Three times as stiff and as adhesive as silica, so that its spheres overlap by as much and the two lattices fit
HARD = Material(3 * 73e9, 0.35, 3 * 0.063)
SOFT = Material(73e9, 0.17, 0.063)
COLUMNS = 3


def crystal(rows: int, *, hard: slice = slice(0), density: dict[int, float] | None = None) -> Network:
    """Rows of silica, some of the hard material, each contact at its overlap without force; ends held."""
    kind_of_row = np.zeros(rows, dtype=np.intp)
    kind_of_row[hard] = 1
    probe = Network(np.zeros((2, 2)), np.full(2, 5e-7), np.full(2, 1.0), (SOFT, HARD), kind=np.array([0, 1]))
    length = np.empty((2, 2))
    for a in (0, 1):
        for b in (0, 1):
            A, _, F = probe.coefficients(np.array([a]), np.array([b]))
            length[a, b] = 1e-6 - (F[0] / A[0]) ** (2 / 3)
    constant = length[0, 0]
    steps = np.sqrt(length[kind_of_row[:-1], kind_of_row[1:]] ** 2 - constant**2 / 4)
    height = np.concatenate([[0.0], np.cumsum(steps)])
    row, column = np.divmod(np.arange(rows * COLUMNS), COLUMNS)
    position = np.column_stack([constant * (column + 0.5 * (row % 2)), height[row]])
    weights = np.full(rows, 2200.0)
    for number, value in (density or {}).items():
        weights[number] = value
    return Network(
        position,
        np.full(len(row), 5e-7),
        weights[row],
        (SOFT, HARD),
        kind=kind_of_row[row],
        held=(row == 0) | (row == rows - 1),
        cell=(COLUMNS * constant, np.inf),
    )


@pytest.mark.parametrize("wavenumber", [0.1, 0.802, 2.0, 3.0])
@pytest.mark.parametrize("mass", [0.2, 3.0, 40.0])
def test_a_heavy_row_reflects_longitudinal_waves_as_a_mass_in_a_chain(wavenumber: float, mass: float) -> None:
    found = scattering(heavy_rows(Contact(0.17), [mass]), np.sin(wavenumber / 2), "L")
    expected = 1 / (1 + ((mass - 1) * np.tan(wavenumber / 2)) ** 2)
    assert found.wavenumber == pytest.approx(wavenumber, rel=1e-9)  # rounding, √ of it near π
    assert found.transmitted["L"] == pytest.approx(expected, rel=1e-9)
    other = scattering(heavy_rows(Contact(0.17), [1.05 * mass]), np.sin(wavenumber / 2), "L").transmitted["L"]
    assert abs(other / expected - 1) > 1e-5  # a wrong mass is seen, far above what is allowed


MASSES = [3.0, 0.5, 2.0, 1.0, 7.0]
WAVES = [("L", 0.3), ("L", 0.9), ("TR", 0.3), ("TR", 0.8), ("RT", 1.2), ("RT", 1.7)]


@pytest.mark.rounding
@pytest.mark.parametrize(("name", "frequency"), WAVES)
@pytest.mark.parametrize("contact", [CONTACT, Contact(0.3, overlap_ratio=1e-3, prestress=0.7)])
def test_energy_is_conserved_and_ways_are_reciprocal(name: str, frequency: float, contact: Contact) -> None:
    rows = heavy_rows(contact, MASSES)
    there, back = scattering(rows, frequency, name), scattering(rows.reversed, frequency, name)
    # Rounding of some hundred operations
    assert there.balance == pytest.approx(1.0, abs=1e-12)
    assert there.transmitted[name] == pytest.approx(back.transmitted[name], abs=1e-12)


@pytest.mark.parametrize(("name", "frequency"), WAVES)
def test_equal_rows_let_all_pass_and_a_row_too_heavy_to_move_nothing(name: str, frequency: float) -> None:
    assert scattering(heavy_rows(CONTACT, [1.0]), frequency, name).transmitted[name] == pytest.approx(1.0, abs=1e-12)
    blocked = scattering(heavy_rows(CONTACT, [1e9]), frequency, name)
    assert blocked.reflected[name] == pytest.approx(1.0, abs=1e-12)  # transmission falls as the square of the mass


def test_crests_of_rt_run_against_its_energy() -> None:
    assert scattering(heavy_rows(CONTACT, [2.0]), 1.5, "RT").wavenumber < 0


# --- from a network --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "frequency"), WAVES)
def test_rows_of_a_network_are_those_of_its_contact(name: str, frequency: float) -> None:
    network = crystal(14, density={6: 4400.0, 7: 1100.0})
    found = scattering(rows_of(network, 2, 11), frequency / SILICA.time_scale, name)
    expected = scattering(heavy_rows(CONTACT, [2.0, 0.5]), frequency, name)
    # Overlaps from positions: 1e-16 of a radius in 2.5e-4 of it, times the sensitivity of a reflection
    assert found.transmitted[name] == pytest.approx(expected.transmitted[name], abs=1e-8)
    assert found.reflected[name] == pytest.approx(expected.reflected[name], abs=1e-8)


def test_rows_of_a_network_have_its_adhesion() -> None:
    jkr = replace(SILICA, adhesion_law="jkr")
    row, column = np.divmod(np.arange(12 * COLUMNS), COLUMNS)
    length = 1e-6 - jkr.static_overlap
    network = Network(
        length * np.column_stack([column + 0.5 * (row % 2), np.sqrt(0.75) * row]),
        np.full(len(row), 5e-7),
        np.where(row == 6, 4400.0, 2200.0),
        (SOFT,),
        cell=(COLUMNS * length, np.inf),
        adhesion="jkr",
    )
    found = scattering(rows_of(network, 2, 9), 0.3 / jkr.time_scale, "TR")
    contact = Contact(0.17, overlap_ratio=jkr.overlap_ratio, adhesion_law="jkr")
    assert found.transmitted["TR"] == pytest.approx(scattering(heavy_rows(contact, [2.0]), 0.3, "TR").transmitted["TR"])
    other = scattering(heavy_rows(CONTACT, [2.0]), 0.3, "TR").transmitted["TR"]
    assert abs(found.transmitted["TR"] / other - 1) > 1e-3


def test_blocks_are_the_derivatives_of_the_forces_of_the_network() -> None:
    network = crystal(10, hard=slice(5, None), density={4: 5000.0})
    rows = rows_of(network, 1, 8)
    small, number = 1e-7 * SILICA.static_overlap, 3  # row 4 of the network, in front of the interface
    spheres = np.arange(COLUMNS) + COLUMNS * (number + 1)
    for freedom in range(3):
        displacement, rotation = np.zeros((len(network.position), 2)), np.zeros(len(network.position))
        if freedom < 2:
            displacement[spheres[1], freedom] = small
        else:
            rotation[spheres[1]] = small / 5e-7
        pull = forces(network, start(network, displacement, 0.0, rotation)) - forces(network, start(network, 0.0, 0.0))
        found = -(pull * network.mobility * np.array([1, 1, 5e-7])[:, None]).T / small  # accelerations
        for near, block in ((number, rows.on_site[number]), (number + 1, rows.ahead[number].T)):
            expected = block[:, 3 + freedom].reshape(COLUMNS, 3) / rows.mass[near].reshape(COLUMNS, 3)
            # Differences over 1e-7 of an overlap hold 1e-6 of it, and the mean torque arm is off by 1e-5
            scale = np.abs(rows.on_site[number]).max() / rows.mass[number][0]
            np.testing.assert_allclose(found[COLUMNS * (near + 1) + np.arange(COLUMNS)], expected, atol=3e-5 * scale)


@pytest.mark.rounding
@pytest.mark.parametrize(("name", "frequency"), [("L", 0.35), ("TR", 0.35), ("RT", 1.45)])
def test_an_interface_of_two_materials_conserves_energy_and_is_reciprocal(name: str, frequency: float) -> None:
    rows = rows_of(crystal(14, hard=slice(7, None)), 2, 11)
    frequency /= SILICA.time_scale
    there = scattering(rows, frequency, name)
    assert there.balance == pytest.approx(1.0, abs=1e-12)  # rounding
    for way, share in there.transmitted.items():
        if share > 1e-12:
            back = scattering(rows.reversed, frequency, way)
            # Rows beyond differ from the outermost ones by rounding of positions, 1e-12 of an overlap
            assert back.transmitted[name] == pytest.approx(share, abs=1e-10)


def test_an_interface_turns_rt_into_tr_where_only_tr_runs_behind() -> None:
    rows = rows_of(crystal(14, hard=slice(7, None)), 2, 11)
    found = scattering(rows, 1.45 / SILICA.time_scale, "RT")
    assert found.transmitted["TR"] > 0.01


def test_a_row_with_empty_places_makes_diffraction_orders_above_their_cutoff() -> None:
    whole = crystal(14)
    there = np.arange(len(whole.position)) != 6 * COLUMNS + 1
    network = replace(
        whole,
        position=whole.position[there],
        radius=whole.radius[there],
        density=whole.density[there],
        kind=whole.kinds[there],
        held=None,
    )
    rows = rows_of(network, 2, 11)
    low, high = (scattering(rows, frequency / SILICA.time_scale, "L") for frequency in (0.2, 0.8))
    for found in (low, high):
        assert found.balance == pytest.approx(1.0, abs=1e-12)  # rounding
        assert 0.05 < found.transmitted["L"] < 0.999
    assert not [each for each in low.transmitted if each.startswith("order")]
    assert high.transmitted["order +1"] == pytest.approx(high.transmitted["order -1"], rel=1e-6)  # its mirror
    assert high.transmitted["order +1"] > 1e-3


def energies(network: Network, motion: np.ndarray, count: int) -> np.ndarray:
    """Kinetic and potential energy (count − 2,) of each row but the held ones, from the motion (6, N)."""
    rows = rows_of(network, 1, count - 2)
    scale = np.array([1.0, 1.0, 5e-7])[:, None]
    moved, speed = ((part * scale).T.reshape(count, -1)[1:-1] for part in (motion[:3], motion[3:]))
    pull = np.einsum("nab,nb->na", np.array(rows.on_site), moved)
    pull[:-1] += np.einsum("nab,nb->na", np.array(rows.ahead), moved[1:])
    pull[1:] += np.einsum("nab,na->nb", np.array(rows.ahead), moved[:-1])
    return np.sum(speed**2 * np.array(rows.mass) + moved * pull, axis=1) / 2


@pytest.mark.parametrize(
    ("name", "wavenumber", "until"), members([("L", 0.8, 115.0), ("TR", 1.0, 145.0)], ("L", 0.8, 115.0))
)
def test_the_network_in_time_shares_the_energy_of_a_packet_so(name: str, wavenumber: float, until: float) -> None:
    count, middle, width, interface = 145, 60, 6.0, 90
    network = crystal(count, hard=slice(interface, None))
    rows = rows_of(network, interface - 4, interface + 3)
    row = np.repeat(np.arange(count), COLUMNS)
    # A packet of the modes of silica; each of its waves runs forward. So many repeat it after 2π · 5 · width = 188 rows
    numbers = wavenumber + np.linspace(-4, 4, 41) / width
    weights = np.exp(-(((numbers - wavenumber) * width) ** 2) / 2)
    field, rate = np.zeros((2, count, 3))
    shares = []
    for number, weight in zip(numbers, weights, strict=True):
        wave = mode_of(name, number, CONTACT.closed)
        shape = np.array([0, 1, 0]) if name == "L" else np.array([-wave.q, 0, 1j * wave.f])
        turn = np.exp(1j * number * (np.arange(count) - middle))[:, None] * shape * weight
        field += turn.real
        rate += (-1j * wave.frequency * turn).real
        energy = weight**2 * wave.frequency**2 * np.sum(np.abs(shape) ** 2 * [1, 1, 0.4])
        shares.append((energy, scattering(rows, wave.frequency / SILICA.time_scale, name).transmitted[name]))
    power, transmitted = np.array(shares).T
    small = 1e-5 * SILICA.static_overlap / np.abs(field).max()  # contacts are linear to that
    moved, speed = small * field[row], small * rate[row] / SILICA.time_scale
    state = start(network, moved[:, :2], speed[:, :2], moved[:, 2] / 5e-7, speed[:, 2] / 5e-7)
    run = integrate(network, state, [until * SILICA.time_scale], rtol=1e-7)
    there = energies(network, run.motion[0], count)
    # What has not passed yet, and the tails of the packet: 1e-3
    assert there[interface - 1 :].sum() / there.sum() == pytest.approx(power @ transmitted / power.sum(), abs=1e-3)
    other = rows_of(crystal(14, hard=slice(7, None), density={7: 2.0 * 2200}), 2, 11)
    few = slice(None, None, 4)
    wrong = [
        scattering(other, mode_of(name, n, CONTACT.closed).frequency / SILICA.time_scale, name).transmitted[name]
        for n in numbers[few]
    ]
    share = power[few] @ wrong / power[few].sum()
    assert abs(share - there[interface - 1 :].sum() / there.sum()) > 0.01
