"""Coherent second harmonic of a wave in a perfect or imperfect crystal, with its error.

At the start a running or standing wave Re[U e^{i(k·r + θ)}] fills the crystal; r is counted from the recorded sphere.
The motion of second order is proportional to e^{2iθ}. Its coherent part is periodic along the wave,

    u(r, τ) = Re[C(τ) e^{2ik·r}] + scattered,        C ∝ e^{2iθ},

with C along k and across, in D0. The scattered part has other wave vectors. Disorder also scatters the wave into 2k, in
first order; that part is proportional to e^{iθ}, so several phases θ separate the two, and a single run cannot. There
are four methods:

* **theory**, for perfect crystals and layers: second order of `granular_analysis.theory.scenes`. Its crystal has no
  ends; between held rows it describes the middle until the waves from the ends arrive, while the other methods fit the
  whole crystal;
* **cell**, for any spheres at rest without dashpots: second order of `granular_analysis.theory.cell`, from the first
  snapshot of a run. It has no time step, and at every size is faster than the network;
* **network**, also with dashpots: integrated from the first snapshot with the phases `PHASES`, at the amplitude a of
  the run and at a/2. C(a) and C(a/2) together give the second order, which is C, and the fourth, which is its error;
* **runs** of one scene that differ in `wave.phase`: at each snapshot, a least-squares fit of e^{−2iθ} to e^{2iθ} over
  the phases gives C and its standard error. Six equally spaced phases keep third order out of C, but not out of the
  error.

The error of theory and cell is an upper estimate of the next order: (a² + 2|θ|) times the largest |C| so far, where
θ(t) is the phase shift of the wave by third order in the perfect crystal (`granular_analysis.theory.validity.turned`).
For a cell, a is at least the largest stretch of a contact over the stretch that opens it, and θ is multiplied by the
mean square deformation of the contacts over that of the perfect crystal.

When it breaks: if contacts open or slide, which is refused; at long times, as the error says; in a cell so short that
2k is not a wave of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.measure.coherent import HARMONICS, project
from granular_analysis.measure.runs import all_but
from granular_analysis.measure.snapshot import FirstSnapshot, first_snapshot
from granular_analysis.theory.catalogue import (
    AT_REST,
    ENVELOPE,
    FACES,
    HELD,
    HOLDS,
    IN_SPACE,
    NETWORK,
    OPENING,
    SLIDING,
    STRUCK,
)
from granular_analysis.theory.cell import Cell, second_order
from granular_analysis.theory.choice import traits_of
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import start
from granular_analysis.theory.scenes import Setting
from granular_analysis.theory.scenes import need_wave as need_wave
from granular_analysis.theory.validity import reached, turned
from granular_lmp.runs.record import Record, Scene

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

PHASES = 2 * np.pi / 6 * np.arange(6)  # on these, the next order that looks like e^{2iθ} is the fourth
ORDERS = np.arange(-2, 3)
HELD_HERE = (HOLDS[NETWORK] | HELD) - {AT_REST, ENVELOPE, SLIDING, OPENING} - STRUCK - FACES - IN_SPACE
RTOL = 1e-9
UNIFORM = {
    "inclusion": [],
    "pair": [],
    "packing.table": "",
    "disorder.stiffness": 0.0,
    "disorder.radius": 0.0,
    "disorder.density": 0.0,
    "disorder.vacancies": 0.0,
}
# Largest relative deviation of the start from a plane wave. Spheres of unequal radii rest an overlap away from their
# sites, which gives 1e-4; a striker that moves one sphere of a thousand gives more than this limit
PLANE_WAVE = 1e-2


@dataclass(frozen=True, eq=False)
class Harmonic:
    """A coherent second harmonic.

    Attributes
    ----------
    by : method: "theory", "cell", "network" or "runs".
    scene : scene of the wave.
    tau : (T,) times.
    amplitudes : (T, 2) complex, C along k and across, in D0.
    errors : (T, 2) errors in D0; nan if unknown.
    """

    by: str
    scene: Scene
    tau: Floats
    amplitudes: Complexes
    errors: Floats

    @property
    def way(self) -> str:
        """Return the method in words."""
        endless = self.by == "theory" and self.scene.shape.ends != "periodic"
        return "theory, of a crystal without ends" if endless else self.by

    @property
    def strength(self) -> Floats:
        """Return the root mean square of |C| over τ along k and across, (2,)."""
        return np.sqrt(np.mean(np.abs(self.amplitudes) ** 2, axis=0))

    @property
    def strength_error(self) -> Floats:
        """Return the root mean square of the errors over τ, (2,): a bound on the error of the strength."""
        return np.sqrt(np.mean(self.errors**2, axis=0))


def by_theory(scene: Scene, tau: ArrayLike) -> Harmonic:
    """Return the second harmonic at times τ (T,) by **theory**, for a scene with a perfect crystal or layers.

    Raises ValueError for a scene that `granular_analysis.theory.scenes` leaves out.
    """
    times = np.asarray(tau, dtype=float)
    amplitudes, off = Setting(scene).harmonic(times)
    return Harmonic("theory", scene, times, amplitudes, _next_order(scene.amplitude**2 + off, amplitudes))


def by_cell(record: Record, tau: ArrayLike | None = None) -> Harmonic:
    """Return the second harmonic of a run at times τ (T,), by default those of its record, by the **cell** method.

    Raises ValueError for a run without a plane wave that fills its crystal, for a run whose contacts may slide or open,
    if the wave opens a contact, and for a run that `granular_analysis.theory.cell` leaves out.
    """
    started = _Started.of(record)
    first, times = started.first, record.tau if tau is None else np.asarray(tau, dtype=float)
    cell = Cell.of(first.network)
    size = np.ones((3, len(started.places)))
    size[2] = first.network.radius
    place, rate = ((part * size).T.ravel() for part in np.split(started.wave, 2))
    found = second_order(cell, place, rate, readout(started.places, started.wavevector), times * first.time)
    if found.reached.opening > 1:
        raise ValueError(f"the wave opens a contact: {found.reached.opening:.3g} times the stretch at which it opens")
    amplitudes = found.signal / first.length
    setting = Setting(record.scene.with_values(UNIFORM))
    lattice, mode = setting.crystal(), setting.mode().times(record.scene.displacement_amplitude)
    uniform = reached(lattice.bonds.law, lattice.bonds.strain(mode.shape, mode.wavevector))
    farther = found.reached.strength / uniform.strength
    off = turned(lattice, (mode,), times * record.scene.sphere.time_scale)
    share = max(record.scene.amplitude, found.reached.opening) ** 2 + 2 * farther * off
    return Harmonic("cell", record.scene, times, amplitudes, _next_order(share, amplitudes))


def _next_order(share: Floats, amplitudes: Complexes) -> Floats:
    """Return the errors (T, 2): shares (T,) of the largest |C| so far, because C itself passes through 0."""
    return share[:, None] * np.maximum.accumulate(np.abs(amplitudes), axis=0)


def by_network(record: Record, tau: ArrayLike | None = None) -> Harmonic:
    """Return the second harmonic of a run at times τ (T,), by default those of its record, by the **network** method.

    Raises ValueError for a run without a plane wave that fills its crystal, for a run whose contacts may slide or open,
    and for a run that the network leaves out.
    """
    started = _Started.of(record)
    times = record.tau if tau is None else np.asarray(tau, dtype=float)
    whole, half = (started.over_phases(share, times) for share in (1.0, 0.5))
    fourth = 4 / 3 * (whole - 4 * half)  # The part d a⁴ of C = c a² + d a⁴, from a and a/2
    return Harmonic("network", record.scene, times, whole - fourth, np.abs(fourth))


def by_runs(records: Sequence[Record]) -> Harmonic:
    """Return the second harmonic at the snapshots of **runs** that differ in `wave.phase`; C has the θ of the first.

    Raises ValueError for fewer than six phases, for phases that do not separate the orders, and for runs that differ in
    more than the phase.
    """
    for record in records:
        _refuse(record)
    if len({repr(all_but(record, "wave.phase")) for record in records}) > 1:
        raise ValueError("the runs differ in more than wave.phase")
    places, k = _places(records[0], first_snapshot(records[0]))
    phases = np.array([record.scene.require_wave().phase for record in records])
    found = [project(places, record.snapshots().stack("displacement"), k.tolist()).amplitudes[1] for record in records]
    amplitudes, errors = over_phases(phases - phases[0], np.array(found))
    return Harmonic("runs", records[0].scene, records[0].snapshots().tau, amplitudes, errors)


def over_phases(phases: ArrayLike, values: Complexes) -> tuple[Complexes, Floats]:
    """Return the coefficient of e^{2iθ} in values (n, ...) at phases θ (n,), and its standard error.

    Least squares with the orders e^{−2iθ} to e^{2iθ}. Raises ValueError for fewer than six phases, and for phases that
    do not separate these orders. Good values: six phases, π/3 apart.
    """
    angle = np.asarray(phases, dtype=float)
    basis = np.exp(1j * np.multiply.outer(angle, ORDERS))
    if len(angle) <= len(ORDERS) or np.linalg.matrix_rank(basis, tol=1e-3) < len(ORDERS):
        raise ValueError(f"wave.phase has {len(angle)} values that do not separate the orders; use six, pi/3 apart")
    inverse = np.linalg.pinv(basis)
    flat = values.reshape(len(angle), -1)
    fitted = inverse @ flat
    left = np.sum(np.abs(flat - basis @ fitted) ** 2, axis=0) / (len(angle) - len(ORDERS))
    error = np.sqrt(left * np.sum(np.abs(inverse[-1]) ** 2))
    return fitted[-1].reshape(values.shape[1:]), error.reshape(values.shape[1:])


def _refuse(record: Record) -> None:
    need_wave(record.scene)
    if other := sorted(traits_of(record) - HELD_HERE):
        raise ValueError(f"the second harmonic of a cell leaves out {', '.join(other)}")


def _places(record: Record, first: FirstSnapshot) -> tuple[Floats, Floats]:
    """Return places (N, 2) from the recorded sphere, and k (2,) fitted to the cell, which is slightly strained."""
    network = first.network
    wanted = Setting(record.scene).wavevector() * record.scene.sphere.radius / first.radius
    cell = np.array(network.cell)
    periods = np.where(np.isfinite(cell), cell, 1.0)
    fitting = 2 * np.pi * np.round(wanted * periods / (2 * np.pi)) / periods
    return network.position - network.position[first.recorded], np.where(np.isfinite(cell), fitting, wanted)


@dataclass(frozen=True, eq=False)
class _Started:
    """Start of a run as a complex wave Z: the motion with phase θ is Re[Z e^{iθ}].

    Attributes
    ----------
    first : the first snapshot.
    places : (N, 2) places from the recorded sphere.
    wavevector : (2,) k.
    wave : (6, N) Z of displacement, rotation, velocity and spin; 0 for held spheres.
    """

    first: FirstSnapshot
    places: Floats
    wavevector: Floats
    wave: Complexes

    @classmethod
    def of(cls, record: Record) -> "_Started":
        """Return the start of a run; raise ValueError if it is not a plane wave, or has traits that are left out."""
        _refuse(record)
        first = first_snapshot(record)
        places, k = _places(record, first)
        free = np.ones(len(places), dtype=bool) if first.network.held is None else ~first.network.held
        phase, motion = places @ k, first.state.motion * free
        basis = np.stack([np.cos(phase), -np.sin(phase)], axis=1) * free[:, None]
        weights = np.linalg.lstsq(basis, motion.T)[0]  # The wave is Re[(a + ib) e^{ik·r}]
        size = np.array([1, 1, first.radius] * 2)[:, None]
        for rows in (slice(3), slice(3, 6)):
            left = (size * (motion - (basis @ weights).T))[rows]
            if np.linalg.norm(left) > PLANE_WAVE * np.linalg.norm((size * motion)[rows]):
                raise ValueError("the first snapshot is not a plane wave that fills the cell")
        return cls(first, places, k, (weights[0] + 1j * weights[1])[:, None] * np.exp(1j * phase) * free)

    def over_phases(self, share: float, tau: Floats) -> Complexes:
        """Return C (T, 2) of the network, in D0 of the run, for the starts Re[share Z e^{iθ}] with θ in `PHASES`."""
        found = []
        for phase in PHASES:
            motion = np.real(share * self.wave * np.exp(1j * phase))
            state = start(self.first.network, motion[:2].T, motion[3:5].T, motion[2], motion[5])
            run = integrate(self.first.network, state, tau * self.first.time, rtol=RTOL)
            field = run.displacement / self.first.length
            found.append(project(self.places, field, self.wavevector.tolist()).amplitudes[1])
        return over_phases(PHASES, np.array(found))[0]


def readout(places: Floats, wavevector: Floats) -> Complexes:
    """Return the matrix P (2, 3N) with P·Y = C along k and across, for a field Re[Y e^{2iθ}] at places (N, 2).

    The fit is that of `granular_analysis.measure.coherent.project`, restricted to motion proportional to e^{2iθ}.
    """
    phase = places @ wavevector
    waves = [wave(n * phase) for n in HARMONICS for wave in (np.cos, np.sin)]
    weights = np.linalg.pinv(np.stack([np.ones(len(places)), *waves], axis=1))
    along = wavevector / np.hypot(*wavevector)
    ways = np.array([along, [-along[1], along[0]]])
    rows = np.zeros((2, len(places), 3), dtype=complex)
    rows[:, :, :2] = ways[:, None] * (0.5 * (weights[3] - 1j * weights[4]))[:, None]
    return rows.reshape(2, -1)
