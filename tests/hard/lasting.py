"""The energy of a crystal of the network over many steps, by JAX: what the step leaves, and what rounding adds.

With the largest frequency Ω, n steps of length h and N spheres, the energy departs by a share of that of motion of

    |E(n) − E(0)| ≤ (Ωh/2)²/(1 − (Ωh/2)²) + c ε √(n/N)

The first term is Verlet's, at any n: a mode keeps ½v² + ½Ω²x²(1 − (Ωh/2)²), and spheres start at rest places, where
that is the energy. The second is rounding, a part of ε = 2.2e-16 of each sphere's energy at random at each step. It is
told from the first by a run there and back, as all but rounding comes back. With shear E − W stands for E, and the
tangents of LAMMPS's steps add what `tests.hard.steps` measures.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.norms import slope
from granular_analysis.theory.network import Law, Material, Network
from granular_analysis.theory.network_ledger import energy, work_rate
from granular_analysis.theory.network_state import State, start
from granular_analysis.theory.network_verlet import Bodies, Carried, Moment, begun, seen, stepped
from granular_lmp.crystal.sphere import Sphere
from tests.hard.case import Case, Cases
from tests.hard.cell import Floats
from tests.hard.grazing import energy_of
from tests.hard.steps import LIMIT
from tests.hard.waves import PERIODIC

jax = pytest.importorskip("jax")
traced = pytest.importorskip("granular_analysis.theory.network_traced", reason="needs JAX")

SPHERE: Sphere = PERIODIC.sphere
UNIT = SPHERE.time_scale
SIZE = 0.02  # of random velocities, in Δ0/t0
EPSILON = float(np.finfo(float).eps)
# √(6k/m), at the edge of the zone where spheres neither turn nor are sheared, in rad per τ
TOP = float(np.sqrt(6 * SPHERE.normal_stiffness / SPHERE.mass) * UNIT)
LOOKS = 100


@cache
def crystal(rows: int, columns: int, shear: bool, viscosity: float = 0.0) -> Network:
    """Return a periodic crystal of the paper's spheres; without shear they do not turn."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    high, length = np.sqrt(3) / 2, SPHERE.lattice_constant
    places = length * np.stack([column + 0.25 + row % 2 / 2, (row + 0.25) * high], axis=1)
    alike, silica = np.ones(len(places)), Material(SPHERE.youngs_modulus, SPHERE.poisson_ratio, SPHERE.work_of_adhesion)
    cell = (columns * length, rows * length * high)
    return Network(
        *(places, SPHERE.radius * alike, SPHERE.density * alike, (silica,)),
        cell=cell,
        shear=shear,
        rotation=shear,
        viscosity=viscosity * SPHERE.mass / UNIT,
    )


def shaken(network: Network, seed: int = 1) -> State:
    """Return spheres at their places with random velocities."""
    velocity = np.random.default_rng(seed).normal(size=network.position.shape)
    return start(network, 0.0, SIZE * SPHERE.static_overlap / UNIT * (velocity - velocity.mean(axis=0)))


def moving(network: Network, motion: Any) -> float:
    """Return the energy of motion."""
    return float(np.sum(network.mass * np.asarray(motion[3]) ** 2 + network.mass * np.asarray(motion[4]) ** 2) / 2)


@partial(jax.jit, static_argnums=(0, 1))
def worked(network: Network, law: Law, arrays: Any, bodies: Bodies, now: Carried, every: Any) -> Any:
    """Return `LOOKS` moments of a motion, and the works of the shear law until there by the trapezoidal rule."""
    pairs, ledger, values = traced.pairs_of(network, arrays), replace(network, law=law), np.zeros((0, 2))

    def power(now: Carried) -> Any:
        return work_rate(ledger, pairs, seen(network, pairs, now))

    def one(_: int, carry: Any) -> Any:
        now, before, work = carry
        now = stepped(network, pairs, bodies, now, values)
        after = power(now)
        return now, after, work + bodies.step * (before + after) / 2

    def look(carry: Any, _: None) -> Any:
        carry = jax.lax.fori_loop(0, every, one, carry)
        return carry, (carry[0], carry[2])

    return jax.lax.scan(look, (now, power(now), 0.0), None, LOOKS)[1]


def departure(network: Network, steps: int, step: float, law: Law = "secant") -> Floats:
    """Return the energy less the works at looks, less that at the start, over that of motion there."""
    state, bodies = shaken(network), Bodies.of(network, step * UNIT)
    first = traced.on_device(begun(network, state, bodies))
    arrays = traced.arrays_of(state.pairs)
    found, works = worked(network, law, arrays, traced.on_device(bodies), first, steps // LOOKS)
    motions, memories, closed = (np.array(each) for each in (found.motion, found.memory, found.begun))
    energies = [energy_of(network, state, motions[:, at], memories[:, at], closed[at]) for at in range(LOOKS)]
    return (np.array(energies) - np.array(works) - energy(network, state).total) / moving(network, state.motion)


def kept(
    rows: int,
    columns: int,
    steps: int,
    share: float = 0.1,
    shear: bool = False,
    viscosity: float = 0.0,
    law: Law = "secant",
    pace: float = 1.0,
) -> Cases:
    """How far the energy departs over a run, at a share of the longest step, or in truth `pace` times that."""
    network = crystal(rows, columns, shear, viscosity)
    left = departure(network, steps, share * pace * (LIMIT if shear else 2 / TOP), law)
    where = f"{rows * columns} spheres, network {'with' if shear else 'without'} shear, {steps:.0e} steps"
    return [
        Case(
            f"departure of the energy{' less the works' if shear else ''}, {where} of {share:g} of the limit",
            f"a trend of {share**2 / steps:.0e} of the energy of motion a step shows",
            float(np.abs(left).max()),
            "(Ωh/2)²/(1 − (Ωh/2)²) of the fastest mode, whatever the number of steps; rounding is far below",
            most=share**2 / (1 - share**2),
        ),
    ]


def order(steps: Sequence[float] = (0.2, 0.1, 0.05), viscosity: float = 0.0) -> Cases:
    """Order in the step of that departure."""
    network = crystal(8, 4, False, viscosity)
    found = [float(np.abs(departure(network, round(400 / step / TOP), 2 * step / TOP)).max()) for step in steps]
    return [
        Case(
            f"order in h of the same, 32 spheres ({found[0]:.1e} → {found[-1]:.1e})",
            "a loss that is no error of the step would show",
            slope(steps, found),
            "2",
            least=1.9,
            most=2.1,
        )
    ]


def there_and_back(rows: int, columns: int, steps: int, seeds: int) -> float:
    """Return the root mean square of the energy of motion that is gained by running there and back, as a share."""
    network, gains = crystal(rows, columns, False), []
    for seed in range(seeds):
        state, step = shaken(network, seed), 0.2 * UNIT
        (there,) = traced.moments(network, state, step, [steps])
        turned = [row if number < 3 else -row for number, row in enumerate(there.now.motion)]
        begin = Moment(0, there.state, there.now._replace(motion=tuple(turned)))
        (back,) = traced.moments(network, there.state, step, [steps], begin)
        gains.append(moving(network, back.now.motion) / moving(network, state.motion) - 1)
    return float(np.sqrt(np.mean(np.square(gains))))


def rounded(sizes: Sequence[tuple[int, int]], counts: Sequence[int], seeds: int = 4, scale: float = 1.0) -> Cases:
    """Size and law of what rounding adds, by runs there and back of several lengths and several crystals."""
    found = np.array([[there_and_back(*size, count, seeds) for count in counts] for size in sizes])
    spheres = np.array([rows * columns for rows, columns in sizes])
    law = EPSILON * np.sqrt(2 * np.array(counts) / spheres[:, None])
    ratio = found / law / scale
    where = f"{spheres[0]} to {spheres[-1]} spheres, n = {2 * counts[-1]:.0e}"
    cases = [
        Case(
            f"energy gained there and back over ε√(n/N), {where}",
            "each step rounds each velocity, and a bias would add up",
            float(ratio.max()),
            "of the order of 1: ten roundings by ε/√12 of a velocity in a step, and a factor of 3 of four runs; of one "
            "sign they would be √n times as much",
            least=0.1,
            most=10.0,
        )
    ]
    if len(counts) > 2:
        cases.append(
            Case(
                f"its power of n, {counts[0]:.0e} to {counts[-1]:.0e} steps there",
                "a bias grows with n itself",
                slope(counts, found.mean(axis=0)),
                "1/2, of roundings at random; a root mean square of 16 errs by 1/√32, the power here by 0.06",
                least=0.3,
                most=0.7,
            )
        )
    return cases
