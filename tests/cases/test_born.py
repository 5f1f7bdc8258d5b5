"""Born's attenuation in a sheet of unequal densities: limits, symmetries, and a sheet integrated with its masses."""

import numpy as np
import pytest

from cases.defects.born import group_speed, impurity_width, long_wave, scattered, sound_speed
from granular_analysis.measure.coherent import decay
from granular_analysis.theory.bloch import branch_index
from granular_analysis.theory.contact import Contact
from tests.manual import Mutant, verifies
from tests.polarisations import bloch_matrix, modes

SILICA = Contact(0.17, overlap_ratio=2.5e-4)
# A zone of 128 x 128 wave vectors, for waves of Ω > 0.15: a fiftieth of a second
COARSE = {"grid": 128, "width": 0.03}
STEP = 0.25


@pytest.mark.parametrize("name", ["L", "TR"])
@verifies(
    "Attenuation of L and TR by random densities, ξ = 0.2",
    reference="analytic: Rayleigh's limit in two dimensions",
    tolerance=0.005,
    reason="dispersion and the width of δ, (0.006/0.07)², take up to 0.3 %",
    mutant=Mutant(
        "analysis/cases/defects/born.py",
        "by_branch = energy.imag / (2 * frequency)",
        "by_branch = energy.imag / frequency",
    ),
)
def test_long_waves_decay_as_rayleigh_says(name, measured):
    # Dispersion and the width of δ, (0.006/0.07)², take up to 0.3 % at ξ = 0.2
    measured(scattered(name, 0.2, SILICA).rate / long_wave(name, 0.2, SILICA) - 1)


@pytest.mark.parametrize("name", ["L", "TR"])
def test_the_power_law_is_q_cubed(name):
    slope = np.log(scattered(name, 0.3, SILICA).rate / scattered(name, 0.2, SILICA).rate) / np.log(1.5)
    assert slope == pytest.approx(3, abs=0.02)  # dispersion, of order ξ², bends it by less


@pytest.mark.parametrize("name", ["L", "TR"])
def test_the_sum_over_the_zone_has_converged(name):
    rough, fine = scattered(name, 0.8, SILICA, grid=256, width=0.012), scattered(name, 0.8, SILICA)
    # The error is of order (width/Ω)²: between the two are three times that of the fine one
    assert rough.rate == pytest.approx(fine.rate, rel=5e-4)
    assert rough.shift == pytest.approx(fine.shift, rel=2e-3)


def test_the_speed_is_left_by_long_waves():
    shifts = [found.shift / found.frequency for found in (scattered("TR", xi, SILICA) for xi in (0.2, 0.4))]
    # −σ²Ω² A(1/c_L² + 1/c_T²) ln(q_D/q)/(8π): four times as large at twice the wave number, less the logarithm's change
    assert shifts[1] < shifts[0] < 0
    assert 2.5 < shifts[1] / shifts[0] < 4


@pytest.mark.parametrize(("name", "wavenumber"), [("L", 0.8), ("TR", 1.2), ("RT", 0.8)])
def test_what_is_lost_arrives_in_the_branches(name, wavenumber):
    found = scattered(name, wavenumber, SILICA, **COARSE)
    assert found.by_branch.sum() == pytest.approx(found.rate, rel=1e-12)  # rounding
    assert np.all(found.by_branch >= 0)
    if name != "RT":  # there is nothing to be scattered into between the top of the acoustic and the optical branch
        assert found.by_branch[2] == pytest.approx(0, abs=1e-9 * found.rate)


def test_scattering_is_the_same_in_equal_directions():
    rates = [scattered("TR", 0.8, SILICA, direction=angle, **COARSE).rate for angle in (30.0, 90.0, -30.0)]
    # The grid is oblique to two of the three; its sum has converged to (width/grid step) beyond 1e-4
    assert rates == pytest.approx([rates[1]] * 3, rel=1e-4)


def test_a_light_defect_is_one_of_the_born_series():
    rate = scattered("TR", 0.8, SILICA, **COARSE).rate
    born = 1e-6 * 2 * rate * np.sqrt(0.75) / group_speed("TR", 0.8, SILICA)
    # ε = 1e-3: the next order of the T matrix is of that relative size
    assert impurity_width("TR", 0.8, 1.001, SILICA, **COARSE) == pytest.approx(born, rel=2e-3)


def test_a_sphere_like_the_others_scatters_nothing():
    assert impurity_width("L", 0.8, 1.0, SILICA, **COARSE) == 0


def integrated(name, number, deviation, seeds, side=48, step=STEP, steps=400):
    """Return τ and C₁(τ) averaged over seeds of a sheet with random masses, integrated through its Bloch matrices.

    The wave vector is `number`/`side` of the reciprocal vector along y.
    """
    reciprocal = 2 * np.pi * np.array([[1.0, -1 / np.sqrt(3)], [0.0, 2 / np.sqrt(3)]])
    steps_of = np.stack(np.meshgrid(np.fft.fftfreq(side), np.fft.rfftfreq(side), indexing="ij"), axis=-1)
    matrix = bloch_matrix(steps_of @ reciprocal, SILICA)
    k = number / side * reciprocal[1]
    branch = int(branch_index(name, k, SILICA))
    frequencies, shapes = modes(k, SILICA)
    frequency, shape = frequencies[branch], shapes[branch]
    phase = np.exp(2j * np.pi * number * np.arange(side) / side) * np.ones((side, 1))
    mass = np.array([1.0, 1.0, 0.4 / (1 - SILICA.overlap_ratio)])
    heavier = 1 + np.random.default_rng(1).normal(0, deviation, (seeds, side, side, 1))
    # A sheet that is heavier as a whole is slower in first order
    heavier -= heavier.mean(axis=(1, 2), keepdims=True) - 1
    weight = -1 / (mass * heavier)

    def acceleration(u):
        spectrum = np.fft.rfft2(u, axes=(1, 2))
        return np.fft.irfft2((matrix @ spectrum[..., None])[..., 0], (side, side), axes=(1, 2)) * weight

    u = np.broadcast_to((phase[..., None] * shape).real, (seeds, side, side, 3)).copy()
    v = np.broadcast_to((-1j * frequency * phase[..., None] * shape).real, u.shape).copy()
    a, found = acceleration(u), []
    component = int(np.argmax(np.abs(shape[:2])))
    for number_of in range(steps + 1):
        if number_of % 40 == 0:
            forward = (u + 1j / frequency * v)[..., component] / 2  # what runs along k, not what is scattered back
            found.append(2 * np.mean(forward * phase.conj()))
        v += step / 2 * a
        u += step * v
        a = acceleration(u)
        v += step / 2 * a
    return step * 40 * np.arange(len(found)), np.array(found), frequency


def test_a_sheet_with_random_masses_decays_at_that_rate():
    tau, amplitude, frequency = integrated("TR", 9, 0.1, seeds=4)
    verlet = 2 / STEP * np.arcsin(frequency * STEP / 2)
    found = decay(tau[1:], (amplitude * np.exp(1j * verlet * tau))[1:])
    theory = scattered("TR", 2 * np.pi * 9 / 48, SILICA, **COARSE)
    # Four sheets of 2304 spheres scatter by 4 % (other seeds). Equal mean masses, without which their frequencies would
    # differ, take k' = k from the sum, 3 % of it in the time of the run; the next order takes 2 %.
    assert found.rate == pytest.approx(0.01 * theory.rate, rel=0.12)
    assert found.frequency == pytest.approx(0.01 * theory.shift, rel=0.15)
    assert found.rate != pytest.approx(0.01 * 1.3 * theory.rate, rel=0.12)  # a rate that is wrong by 30 % is told


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("TR", 0.05, SILICA), r"width = 0\.006 must be from 3/grid = 0\.00586 to a fifth"),
        (("XX", 0.8, SILICA), "name is 'XX'"),
    ],
)
def test_what_cannot_be_computed_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        scattered(*arguments)


def test_rt_has_no_long_wave():
    with pytest.raises(ValueError, match="name = 'RT': must be L or TR"):
        long_wave("RT", 0.2, SILICA)
    with pytest.raises(ValueError, match="mass_ratio = 0 must be positive"):
        impurity_width("TR", 0.8, 0, SILICA)


def test_the_sound_speed_of_l_is_that_of_the_closed_form():
    # Ω = sin(ξ/2) with ξ = (√3/2)k; LAMMPS's geometry and dispersion at k = 1e-3 take less than 1e-6
    assert sound_speed("L", SILICA) == pytest.approx(np.sqrt(3) / 4, rel=1e-6)
