"""Small amplitudes: the noise that rounded positions make, and the signal that is lost in it."""

import numpy as np

from granular_analysis.theory import lattice
from granular_lmp import Scene
from granular_lmp.accuracy.rounding import grain, noise_floor
from granular_lmp.units import units_for
from tests.hard.case import Case, Cases, Edits
from tests.hard.cell import Floats, running
from tests.hard.waves import exact, phases, scene

FACTOR = 3.0  # accuracy of the law according to the docstring of `noise_floor`
OFFSET = (37.31, 137.77)  # nm; moves every sphere to other numbers, and nothing else


def moved(x: float, y: float) -> Edits:
    """The whole cell elsewhere: physics knows no origin, doubles do."""
    here = "group        mobile type 1\n"
    box = f"change_box all x final $(xlo+{x!r}) $(xhi+{x!r}) y final $(ylo+{y!r}) $(yhi+{y!r}) units box\n"
    return ((here, f"{box}displace_atoms all move {x!r} {y!r} 0 units box\n{here}"),)


def noise(wave: Scene, origin: float = 0.0) -> Floats:
    """Noise of p, q, φ (3,) in D0 at the end: the difference of two runs at other places, rms over spheres, over √2."""
    places = []
    for x, y in ((0.0, 0.0), OFFSET):
        with running(wave, moved(x, y + origin)) as cell:
            cell.advance(wave.time.steps)
            places.append(cell.displacement() / wave.wave.amplitude)
    return np.sqrt(np.mean((places[1] - places[0]) ** 2, axis=1) / 2)


def floor(rows: int, amplitude: float, duration: float = 120.0, scale: float = 1.0) -> Cases:
    """Measured noise over the law, in a cell of a length; `scale` falsifies the law."""
    wave = scene("TR", rows // 8, rows, amplitude, 0.05, duration)
    found, law = noise(wave), noise_floor(wave) * scale
    label = f"{rows} rows, a = {amplitude:g}, τ = {duration:g} (law: {law:.1e} D0)"
    return [
        Case(
            f"noise of p over the law, {label}",
            "p is of order a², and a position of 1e5 nm has a grain of 1e-11 nm",
            float(found[0] / law),
            "random roundings: ulp²/12 a step, half of it kept; a law of magnitudes, to a factor of 3",
            least=1 / FACTOR,
            most=FACTOR,
        ),
        Case(
            f"noise of q and φ over the law, {label}",
            "the same",
            float(found[1:].max() / law),
            "they are kicked through the contacts only, and x is short: not above p's",
            most=1.0,
        ),
    ]


def origin(distance: float = 1.4e6, scale: float = 1.0) -> Cases:
    """How the noise of a small cell grows when the cell is put far from the origin; `scale` falsifies the law."""
    wave = scene("TR", 2, 16, 0.01, 0.05, 120)
    metre = units_for(wave.sphere.radius).number(1.0, length=1)
    size = 0.01 * wave.sphere.static_overlap * metre
    law = scale * float(np.sqrt(wave.time.steps / 2) * np.spacing(distance) / np.sqrt(12) / size)
    return [
        Case(
            f"noise of p over the law, 16 rows, {distance:.1e} nm from the origin (law: {law:.1e} D0)",
            "doubles are dense at the origin only",
            float(noise(wave, distance)[0] / law),
            "as above, with the spacing of doubles out there",
            least=1 / FACTOR,
            most=FACTOR,
        )
    ]


def signal(amplitude: float, scale: float = 1.0, edits: Edits = ()) -> Cases:
    """Error of p against the exact lattice: small above the floor, p itself below it; `scale` falsifies the floor."""
    wave = scene("TR", 2, 16, amplitude, 0.025, 60)
    tau = np.arange(0.0, 60.5, 10.0)
    truth = exact(wave, tau)[:, 0] / amplitude
    shift = lattice.periodic_kernel(phases(wave)[:, None] - lattice.torus_phases(31), 31)
    with running(wave, edits) as cell:
        found = cell.follow(tau)[:, 0] / amplitude
    expected = truth @ shift.T
    size = float(np.sqrt(np.mean(expected**2)))
    error = float(np.sqrt(np.mean((found - expected) ** 2)))
    law = scale * max(noise_floor(wave), grain(wave))
    label = f"error of p, a = {amplitude:g}: {error / size:.1g} of the signal, which is {size / law:.1g} of the floor"
    hard = "p falls as a² in nm, the grain of a position does not: below the floor there is no p to see"
    if size < law / FACTOR:
        reason = "steps of p below the grain round back, all but a few: its error is p itself, and noise comes on top"
        return [Case(f"{label}; over the signal", hard, error / size, reason, least=0.9)]
    return [
        Case(
            f"{label}; over its bound",
            hard,
            error / (FACTOR * law + 2e-3 * size),
            "three times the floor (noise or grain, the larger) and 2e-3 of the signal: Verlet's phase of a second "
            "harmonic, (2ΩΔτ)²2Ωτ/24, at Δτ = 0.025",
            most=1.0,
        )
    ]
