"""Every misprint of docs/errata.md derived or decided, and the numbers of its table measured again.

`ERRORS` has, per row of the first table, a function that returns the error of the printed and of the correct form.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from tests.validation import paper_equations as paper
from tests.validation.paper_equations import CORRECT, PRINTED, Coefficients

ERRATA = Path(__file__).parents[2] / "docs" / "errata.md"
KAPPA = float(paper.stiffness_ratio(0.17))  # the silica spheres of the paper
ORDINARY = 0.802  # ξ1 of Fig. 3

z, wave, back = sp.symbols("z E_forward E_backward")  # z = e^{iξ/2}, E = e^{i(ξn ∓ Ωτ)}
Q, Phi, Qc, Phic, P = sp.symbols("Q Phi Qc Phic P")
SIN_XI, SIN2_HALF = (z**2 - z**-2) / (2 * sp.I), -((z - 1 / z) ** 2) / 4


@cache
def derived() -> paper.Row:
    return paper.derived_rows(CORRECT.time_scale_squared)


def vanishes(expression: sp.Expr) -> bool:
    return numerator_of(expression) == 0


def numerator_of(expression: sp.Expr) -> sp.Expr:
    """Numerator over the common denominator, as a sum; much faster than to expand the fractions first."""
    return sp.numer(sp.together(expression)).expand()


@cache
def agrees(coefficients: Coefficients) -> bool:
    """Return whether `eqp`, `eqq`, `eqr` with these factors are the rows derived for the same time scale."""
    scale = coefficients.time_scale_squared / CORRECT.time_scale_squared
    return all(vanishes(scale * a - b) for a, b in zip(derived(), paper.paper_rows(coefficients), strict=True))


# ---------------------------------------------------------------- equations of motion


@cache
def projection_error() -> tuple[float, float]:
    """Largest relative error of a weight of `equ`, `eqv` against virtual work."""

    def worst(factor: sp.Expr) -> float:
        pairs = [
            (float(printed), float(true))
            for label, weights in paper.printed_weights(factor).items()
            for line, exact in zip(weights, paper.force_weights(label), strict=False)
            for printed, true in zip(line, exact, strict=True)
        ]
        assert all(printed == 0 for printed, true in pairs if true == 0)
        return max(abs(printed / true - 1) for printed, true in pairs if true)

    return worst(sp.sqrt(sp.Rational(3, 2))), worst(sp.sqrt(3) / 2)


@cache
def sixth_shear_error() -> tuple[float, float]:
    """Shear at contact 6 when the crystal turns as one body by θ, over Rθ; a rigid rotation strains nothing."""
    theta = sp.Symbol("theta")

    def strain(label: int, shear: sp.Expr) -> float:
        normal, _ = paper.normal_and_tangent(label)
        x, y = (2 * paper.R * component for component in normal)
        turned = {paper.u0: 0, paper.v0: 0, paper.ul: -theta * y, paper.vl: theta * x}
        turned |= {paper.th0: theta, paper.thl: theta}
        return abs(float(sp.simplify(shear.subs(turned) / (paper.R * theta))))

    assert max(strain(label, paper.PRINTED_SEPARATIONS[label][1]) for label in range(1, 6)) == 0
    return strain(6, paper.PRINTED_SEPARATIONS[6][1]), strain(6, paper.separation(6)[1])


def test_the_other_eleven_separations_are_right() -> None:
    wrong = [
        (label, kind)
        for label in paper.CONTACT_ANGLES
        for kind, printed, true in zip("NS", paper.PRINTED_SEPARATIONS[label], paper.separation(label), strict=True)
        if not vanishes(printed - true)
    ]
    assert wrong == [(6, "S")]
    assert vanishes(paper.PRINTED_SEPARATIONS[6][1] - (paper.vl - paper.v0) / 2 - paper.separation(6)[1])


def test_torque_sums_the_six_shear_forces_with_arm_r() -> None:
    assert all(paper.force_weights(label)[2] == (0, paper.R) for label in paper.CONTACT_ANGLES)


def test_taylor_coefficients() -> None:
    for taylor, spring in zip(paper.quadratic_forces(), paper.SPRINGS, strict=True):
        assert sp.simplify(taylor - spring.subs(paper.SPRING_CONSTANTS)) == 0


def test_static_force_cancels() -> None:
    """`springN` leaves the adhesive force out; a constant normal force drops out of every row."""
    assert not any(row.has(paper.k0) for row in derived())


def test_stiffness_ratio_of_hertz_mindlin() -> None:
    young, nu, rc = sp.symbols("E nu R_c", positive=True)
    normal, shear = young / (2 * (1 - nu**2)), young / (2 * (1 + nu)) / (2 * (2 - nu))
    ratio = 8 * shear * sp.sqrt(rc) / (sp.Rational(3, 2) * sp.Rational(4, 3) * normal * sp.sqrt(rc))
    assert sp.simplify(ratio - 2 * (1 - nu) / (2 - nu)) == 0


# ---------------------------------------------------------------- reduced equations


@cache
def time_scale_error() -> tuple[float, float]:
    """Relative error of the cut-off frequency of L, which `Ldisp` sets to one; t0² is a factor of each row."""
    zigzag = dict.fromkeys(paper.UNKNOWNS, 0) | {paper.p[-1]: -1, paper.p[0]: 1, paper.p[1]: -1}
    forced = -derived()[0].subs(zigzag) / CORRECT.time_scale_squared

    def cutoff(time_scale_squared: sp.Expr) -> float:
        return float(sp.sqrt(sp.simplify(time_scale_squared * forced)))

    return cutoff(PRINTED.time_scale_squared) - 1, cutoff(CORRECT.time_scale_squared) - 1


# Rows (p, q, φ) of three neighbours that leave one quadratic term alone, and the equation it stands in.
SINGLE_TERMS = {
    "epsilon": (0, ((0.3, -0.2, 0.9), (0, 0, 0), (0, 0, 0))),
    "p_alpha": (0, ((0, 0, 0), (0.3, -0.2, 0.9), (0, 0, 0))),
    "p_beta": (0, ((0, 0, 0), (0.3, -0.2, 0.3), (0.5, 0.1, -0.4))),
    "q_beta": (1, ((0.3, -0.2, 0.9), (0, 0, 0), (0.5, 0.1, -0.4))),
}


@cache
def row_functions(coefficients: Coefficients) -> Callable[..., list[float]]:
    rows = [row.subs(paper.HERTZ_MINDLIN) for row in paper.paper_rows(coefficients)]
    found: Callable[..., list[float]] = sp.lambdify([paper.kappa, paper.D0, *paper.UNKNOWNS], rows)
    return found


def numeric_rows(coefficients: Coefficients, state: np.ndarray, amplitude: float) -> np.ndarray:
    """The paper's p'', q'', φ'' for three rows, `state` of shape (3 unknowns, 3 rows)."""
    return np.array(row_functions(coefficients)(KAPPA, amplitude, *state.ravel())) / (1, 1, 0.4)


def exact_rows(state: np.ndarray, amplitude: float) -> np.ndarray:
    behind, here, ahead = state.T[:, :, None]
    return paper.exact_acceleration(ahead, here, behind, amplitude, KAPPA)[:, 0]


@cache
def quadratic_error(name: str) -> tuple[float, float]:
    """Relative error of one quadratic term against the even part of the exact acceleration at a = 1e-4."""
    equation, rows = SINGLE_TERMS[name]
    state, amplitude = np.array(rows, dtype=float), 1e-4

    def even(accelerate: Callable[[np.ndarray], np.ndarray]) -> float:
        return float((accelerate(state) + accelerate(-state))[equation])

    exact = even(lambda x: exact_rows(x, amplitude))
    printed = replace(CORRECT, **{name: getattr(PRINTED, name)})
    errors = [abs(even(lambda x, c=c: numeric_rows(c, x, amplitude)) / exact - 1) for c in (printed, CORRECT)]
    return errors[0], errors[1]


@pytest.mark.parametrize("name", SINGLE_TERMS)
def test_equations_with_one_misprint_are_not_those_that_are_derived(name: str) -> None:
    assert agrees(CORRECT)
    assert not agrees(replace(CORRECT, **{name: getattr(PRINTED, name)}))


def test_no_other_epsilon_saves_the_printed_p_equation() -> None:
    """ε stands in three terms of p: no single value of it makes ε/8, εα/6 and εβ/(3√3) right together."""
    scale = sp.Symbol("scale")
    row = paper.paper_rows(replace(PRINTED, epsilon=scale * PRINTED.epsilon))[0]
    terms = map(sp.expand, sp.Poly(numerator_of(row - derived()[0]), *paper.UNKNOWNS).coeffs())
    asked = {sp.cancel(-term.coeff(scale, 0) / term.coeff(scale, 1)) for term in terms if term.has(scale)}
    assert asked == {2 / paper.ROOT3, paper.ROOT3 / 2}


@pytest.mark.parametrize(("name", "order"), [(None, 2), *((name, 1) for name in SINGLE_TERMS)])
def test_only_the_correct_equations_are_second_order(name: str | None, order: int) -> None:
    """The error of the acceleration (in units of D0) falls as a², with one misprint put back only as a."""
    coefficients = CORRECT if name is None else replace(CORRECT, **{name: getattr(PRINTED, name)})
    state = np.array([[0.3, -0.2, 0.9], [0.7, 0.4, -0.6], [0.5, 0.1, -0.4]])
    error = [np.linalg.norm(numeric_rows(coefficients, state, a) - exact_rows(state, a)) for a in (1e-2, 1e-3)]
    assert np.log10(error[0] / error[1]) == pytest.approx(order, abs=0.05)  # next order: a few times a = 1e-2


# ---------------------------------------------------------------- linear modes


def plane_wave(along: sp.Expr, across: sp.Expr, turning: sp.Expr) -> dict[sp.Symbol, sp.Expr]:
    """Values of (p, q, φ) in the three rows for complex amplitudes times e^{iξn}."""
    amplitudes = ((paper.p, along), (paper.q, across), (paper.f, turning))
    return {x[j]: amplitude * z ** (2 * j) for x, amplitude in amplitudes for j in x}


def bloch_matrix() -> sp.Matrix:
    """M of the derived rows for (Q̃, Φ̃) e^{iξn}, with −Ω² left off."""
    plane = plane_wave(P, Q, Phi)
    linear = [row.subs({paper.k2: 0, paper.g2: 0}).subs(plane) for row in derived()]
    assert vanishes(linear[0] + SIN2_HALF * P)  # `Ldisp`, and no coupling to q and φ
    return sp.Matrix([[-sp.expand(row).coeff(x) for x in (Q, Phi)] for row in linear[1:]])


def test_dispersion_matrix_and_l_branch_are_right() -> None:
    cos_xi, mu1, mu2 = (z**2 + z**-2) / 2, paper.MU1, paper.MU2
    printed = sp.Matrix(
        [
            [mu1 / 2 * (1 - cos_xi), sp.sqrt(3) * sp.I * mu2 * SIN_XI],
            [-sp.sqrt(3) * sp.I * mu2 * SIN_XI, 2 * mu2 * (2 + cos_xi)],
        ]
    )
    assert all(vanishes(entry) for entry in printed - bloch_matrix())


@cache
def shape_ratio_error() -> tuple[float, float]:
    """Relative error of Φ̃/Q̃ against the eigenvector of the derived matrix, TR at ξ = 0.802."""
    numbers = {paper.k1: 1, paper.g1: KAPPA, z: np.exp(0.5j * ORDINARY)}
    matrix = np.array(bloch_matrix().subs(numbers).evalf(), dtype=complex) / [[1], [0.4]]
    squares, vectors = np.linalg.eig(matrix)
    lower = int(np.argmin(squares.real))
    exact, omega2 = vectors[1, lower] / vectors[0, lower], squares[lower].real
    mu1, mu2 = (3 * KAPPA + 1) / (KAPPA + 3), KAPPA / (KAPPA + 3)

    def ratio(factor: int) -> complex:
        return -(mu1 * (1 - np.cos(ORDINARY)) - factor * omega2) / (2j * np.sqrt(3) * mu2 * np.sin(ORDINARY))

    return abs(ratio(1) / exact - 1), abs(ratio(2) / exact - 1)


@cache
def normalisation_error() -> tuple[float, float]:
    """|Q̃²+Φ̃²−1| and ||Q̃|²+|Φ̃|²−1| of a unit RT vector at ξ = 0.802, the wave of Fig. 2(b)."""
    shape_q, shape_f = paper.transverse_shape(ORDINARY, KAPPA, float(paper.transverse_branches(ORDINARY, KAPPA)[1]))
    vector = np.array([shape_q, 1j * shape_f])
    return abs(np.sum(vector**2) - 1), abs(np.sum(abs(vector) ** 2) - 1)


# ---------------------------------------------------------------- second harmonic


def complex_forcing(coefficients: Coefficients) -> sp.Expr:
    """Coefficient of ε E² in p'' for complex q=Q̃E, φ=Φ̃E."""
    row = paper.paper_rows(coefficients)[0].subs(plane_wave(sp.Integer(0), Q * wave, Phi * wave))
    return sp.expand(row).coeff(wave, 2) / coefficients.epsilon


@cache
def real_forcing() -> sp.Expr:
    """p'' for the real fields of a forward and an equal backward wave.

    The mirror y → −y keeps q and turns φ; for real Q̃ and imaginary Φ̃ that leaves both amplitudes as they are when the
    backward wave is written with e^{i(ξn+Ωτ)}.
    """
    plane = dict.fromkeys(paper.p.values(), 0)
    for x, amplitude, conjugate in ((paper.q, Q, Qc), (paper.f, Phi, Phic)):
        for j in x:
            waves = (wave * z ** (2 * j), back * z ** (2 * j))
            plane[x[j]] = sum(amplitude * e + conjugate / e for e in waves) / 2
    return sp.expand(derived()[0].subs(plane))


def harmonic(forward: int, backward: int) -> sp.Expr:
    """Coefficient of ε E^forward E_backward^backward in `real_forcing`."""
    return real_forcing().coeff(wave, forward).coeff(back, backward) / CORRECT.epsilon


def numerator(prefactor: sp.Expr) -> sp.Expr:
    """Numerator of `P1TR`."""
    bracket = -paper.BETA / sp.sqrt(3) * SIN_XI * Phi + sp.I * paper.ALPHA * SIN2_HALF * Q
    return prefactor * SIN_XI * Q * bracket


@cache
def complex_prefactor_error() -> tuple[float, float]:
    """Relative error of the prefactor of `P1TR` for complex fields in the equation derived here."""
    prefactor = sp.cancel(sp.together(complex_forcing(CORRECT) / numerator(sp.Integer(1))))
    return abs(4 / 3 / float(prefactor) - 1), abs(1 / float(prefactor) - 1)


def test_printed_prefactor_follows_from_the_printed_equation() -> None:
    """4/3 is what α/6 and β/(3√3) give: one misprint, carried on, not two."""
    printed_terms = replace(CORRECT, p_alpha=PRINTED.p_alpha, p_beta=PRINTED.p_beta)
    assert vanishes(complex_forcing(printed_terms) - numerator(sp.Rational(4, 3)))


def test_real_fields_give_prefactor_one_half() -> None:
    """(Re z)² = ½ Re z² + ½|z|²; the second part is uniform and moves nothing."""
    assert vanishes(2 * harmonic(2, 0) - numerator(sp.Rational(1, 2)))
    assert vanishes(harmonic(0, 0))


@cache
def real_prefactor_error() -> tuple[float, float]:
    """Error of p(τ≤60) over its maximum in the exact lattice at ξ = 0.802, a = 1e-3, for the prefactors 4/3 and ½."""
    amplitude, times = 1e-3, np.linspace(0, 60, 121)
    field = paper.integrate_wave(ORDINARY, KAPPA, amplitude, times)[:, 0]
    measured = 2 * np.fft.fft(field, axis=-1)[:, 2] / field.shape[1]
    omega, free = float(paper.transverse_branches(ORDINARY, KAPPA)[0]), np.sin(ORDINARY)
    shape_q, shape_f = paper.transverse_shape(ORDINARY, KAPPA, omega)
    alpha, beta = (2 * KAPPA - 1) / (2 * KAPPA + 3), 2 * KAPPA / (2 * KAPPA + 3)
    bracket = -beta / np.sqrt(3) * free * 1j * shape_f + 1j * alpha * np.sin(ORDINARY / 2) ** 2 * shape_q
    generated = free * shape_q * bracket / (free**2 - 4 * omega**2)
    plus, minus = -(free + 2 * omega) / (2 * free), -(free - 2 * omega) / (2 * free)  # `Pplus`, `Pminus`
    shape = np.exp(-2j * omega * times) + plus * np.exp(-1j * free * times) + minus * np.exp(1j * free * times)
    epsilon = -np.sqrt(3) * amplitude * (2 * KAPPA + 3) / (4 * (KAPPA + 3))
    errors = [np.max(abs(c * epsilon * generated * shape - measured)) / np.max(abs(measured)) for c in (4 / 3, 1 / 2)]
    return float(errors[0]), float(errors[1])


def test_free_wave_amplitudes_start_from_rest() -> None:
    free, omega = sp.symbols("w Omega", positive=True)
    plus, minus = -(free + 2 * omega) / (2 * free), -(free - 2 * omega) / (2 * free)
    assert vanishes(plus + minus + 1)
    assert vanishes(-free * plus + free * minus - 2 * omega)


def test_l_wave_amplitude_is_half_cot() -> None:
    """i/2·cot(ξ/2), complex fields: grows as 1/ξ in long waves, no resonance in 0<ξ≤π, zero at ξ=π only."""
    plane = plane_wave(wave, sp.Integer(0), sp.Integer(0))
    forcing = sp.expand(derived()[0].subs(plane)).coeff(wave, 2) / CORRECT.epsilon
    cot_half = sp.I * (z + 1 / z) / (z - 1 / z)
    assert vanishes(forcing - sp.I / 2 * cot_half * (SIN_XI**2 - 4 * SIN2_HALF))
    assert [row.subs(plane) for row in derived()[1:]] == [0, 0]


def test_opposite_waves_make_a_standing_static_wave() -> None:
    """Real fields: the product of both waves has wave number 2ξ and no frequency; their quotient (2Ω, no ξ) is idle."""
    assert vanishes(harmonic(1, 1) - 2 * harmonic(2, 0))
    assert vanishes(harmonic(1, -1))


def test_antiresonance_condition_follows_from_the_correct_ratio_only() -> None:
    mu1, mu2, alpha, beta = sp.symbols("mu1 mu2 alpha beta", positive=True)

    def square(factor: int) -> sp.Expr:
        omega2 = sp.Symbol("omega2")
        ratio = -(mu1 * 2 * SIN2_HALF - factor * omega2) / (2 * sp.sqrt(3) * sp.I * mu2 * SIN_XI)
        bracket = -beta / sp.sqrt(3) * SIN_XI * ratio + sp.I * alpha * SIN2_HALF
        return sp.solve(bracket, omega2)[0]

    printed = SIN2_HALF * (mu1 - 3 * mu2 * alpha / beta)
    assert vanishes(square(2) - printed)
    assert vanishes(square(1) - 2 * printed)


# ---------------------------------------------------------------- the document


ERRORS: dict[str, Callable[[], tuple[float, float]]] = {
    "projection_factor_is_half_root_three": projection_error,
    "sixth_shear_refers_to_particle_zero": sixth_shear_error,
    "time_scale_puts_the_cutoff_of_l_at_one": time_scale_error,
    "epsilon_has_root_three": lambda: quadratic_error("epsilon"),
    "alpha_term_has_an_eighth": lambda: quadratic_error("p_alpha"),
    "beta_term_of_p_has_four_root_three": lambda: quadratic_error("p_beta"),
    "beta_term_of_q_has_root_three": lambda: quadratic_error("q_beta"),
    "shape_ratio_has_twice_omega_squared": shape_ratio_error,
    "normalisation_takes_moduli": normalisation_error,
    "complex_fields_give_prefactor_one": complex_prefactor_error,
    "exact_lattice_decides_for_one_half": real_prefactor_error,
}


# Name of a misprint → error printed, bound of the error correct: the last three cells of a row of the first table
CELLS = r"\| *([0-9.]+) *\| *≤ ([0-9.e-]+) *\| *`(\w+)` *\|$"
ROWS = {name: numbers for *numbers, name in re.findall(CELLS, ERRATA.read_text("utf-8"), re.MULTILINE)}


def test_the_page_has_each_misprint() -> None:
    assert ROWS.keys() == ERRORS.keys()


@pytest.mark.parametrize("name", ERRORS)
def test_the_error_of_a_misprint_is_that_of_the_page(name: str) -> None:
    shown, bound = map(float, ROWS[name])
    printed, correct = ERRORS[name]()
    assert printed == pytest.approx(shown, rel=6e-3)  # three digits
    assert printed != pytest.approx(1.025 * shown, rel=6e-3)
    assert correct <= bound
