"""All cases of the stability table: the fast ones, most of which `make test` asserts, and the long ones."""

from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from math import pi
from typing import Any

from granular_analysis.second_harmonic import ModeName
from tests.hard import damped, grazing, space, stretched, struck_sheets
from tests.hard.breathers import breathes
from tests.hard.breathers import order as order_of_breathers
from tests.hard.case import Cases
from tests.hard.decomposition import ranks
from tests.hard.impacts import kept, order
from tests.hard.oblique import CORNERS, corner, pulse
from tests.hard.resonance import at_the_antiresonance, at_the_resonance, blow_up
from tests.hard.rounding import floor, origin, signal
from tests.hard.scales import NUS, corners, similar
from tests.hard.steps import at_the_limit, drift, drift_order, refused, reversal
from tests.hard.sticking import parting, sticking
from tests.hard.strikes import energy, long_chain, velocities
from tests.hard.strikes import order as order_of_strikes
from tests.hard.symmetry import instability, subspace
from tests.hard.zone import ENDS, MODES, degenerate, end

Measure = Callable[[], Cases]
ROUGH = ("secant", "incremental")


def by_jax(module: str, measure: str, *values: Any, **named: Any) -> Cases:
    """Return the cases of a module that needs JAX, which is an extra and slow to import."""
    cases: Cases = getattr(import_module(f"tests.hard.{module}"), measure)(*values, **named)
    return cases


DEGENERATE: tuple[tuple[ModeName, float], ...] = (("L", 0.0), ("TR", 0.0), ("L", 0.4), ("RT", 0.4))

FAST: Mapping[str, Measure] = {
    "resonance": partial(at_the_resonance, 8, 34, 0.05, 100, stride=2),
    "blow-up of a large wave": partial(blow_up, 8, 34, 1.2, 0.0125, 60),
    "antiresonance": partial(at_the_antiresonance, duration=40.0),
    **{
        f"{mode}, xi = {2 * pi * cycles / rows:.4g}": partial(end, mode, cycles, rows, 0.025, 5 if rows > 100 else 20)
        for mode in MODES
        for cycles, rows in ENDS
    },
    **{
        f"{mode} at {place} of the zone": partial(corner, place, mode, 8 if place == "edge" else 20)
        for mode in MODES
        for place in CORNERS
    },
    "pulse": partial(pulse, 40.0, 24, 22),
    **{f"degenerate {mode}, nu = {nu}": partial(degenerate, mode, nu) for mode, nu in DEGENERATE},
    **{f"a = {a}": partial(kept, a) for a in (0.9, 2, 20)},
    **{f"order at a = {a}": partial(order, a) for a in (0.9, 5)},
    **{f"order at a = {a}, jkr": partial(order, a, law="jkr") for a in (2.1, 2.3)},
    "noise of a short cell": partial(floor, 16, 0.01),
    "noise of a long cell": partial(floor, 96, 0.01),
    "noise far from the origin": origin,
    **{
        f"p at a = {a}": partial(signal, a) for a in (1e-2, 1e-3, 1e-5, 1e-6)
    },  # at 1e-4 p is as large as the floor: no claim
    "sizes and units": similar,
    "sizes and units, pressed": partial(similar, pressed=True),
    **{f"corners, nu = {nu}": partial(corners, nu) for nu in NUS},
    "refused steps": refused,
    "limit of the step": partial(at_the_limit, 20_000),
    "time turned round": reversal,
    "L stays L": subspace,
    "order of a struck chain": order_of_strikes,
    **{f"struck at {velocity} m/s": partial(velocities, velocity) for velocity in (1e-6, 1e-3, 1e2)},
    "energy of a struck chain": partial(energy, 400.0),
    "sticking speed": sticking,
    "parting velocity": partial(parting, (400, 1600)),
    "a long chain": partial(long_chain, 10_000, 20.0),
    "a struck sheet": partial(struck_sheets.kept, {}, 100.0),
    "mirror of a struck sheet": partial(struck_sheets.mirrored, {}, 100.0),
    **{f"a rough sheet, {law}": partial(struck_sheets.kept, struck_sheets.rough(law), 30.0) for law in ROUGH},
    **{
        f"mirror of a rough sheet, {law}": partial(struck_sheets.mirrored, struck_sheets.rough(law), 30.0)
        for law in ROUGH
    },
    **{f"order of a rough sheet, {law}": partial(struck_sheets.order, law) for law in ROUGH},
    "energy of a struck sheet": partial(struck_sheets.energy, 500.0),
    "a damped chain": damped.kept,
    "order of a damped chain": damped.order,
    "a breather": partial(breathes, 100),
    "order of a breather": order_of_breathers,
    **{name: partial(space.wave, name) for name in ("hcp next to a zone edge", "fcc under load")},
    "spheres that leave their substrate": partial(space.leaving, duration=6.0),
    "a layer for long": partial(space.kept, 10_000),
    "a layer that buckles": space.buckling,
    **{
        f"the edge of opening, {kind}, {law}": partial(grazing.edge, kind, law)
        for kind in grazing.LAWS
        for law in ROUGH
    },
    "next to a pull-off": partial(stretched.outcome, 1000),
    "order next to a pull-off": stretched.order,
    "slopes next to a pull-off": partial(by_jax, "slopes", "parting"),
    "slopes at the resonance": partial(by_jax, "slopes", "growing", 0.01, 60.0),
    "energy of a network": partial(by_jax, "lasting", "kept", 8, 4, 4000),
    "order of the energy of a network": partial(by_jax, "lasting", "order"),
    "energy of a network with shear": partial(by_jax, "lasting", "kept", 8, 4, 10_000, 0.03, shear=True),
    "rounding of a network": partial(by_jax, "lasting", "rounded", [(8, 4)], [2000]),
}

LONG: Mapping[str, Measure] = {
    "resonance, long": partial(at_the_resonance, 39, 166, 0.0125, 1500, stride=2),
    "blow-up": partial(blow_up, 23, 98, 0.2, 0.0125, 3000),
    **{
        f"{mode}, xi = {2 * pi * cycles / rows:.4g}, long": partial(end, mode, cycles, rows, 0.0125, 120)
        for mode in MODES
        for cycles, rows in ENDS
    },
    **{f"a = {a}": partial(kept, a) for a in (0.5, 1, 5)},
    **{f"order at a = {a}": partial(order, a) for a in (0.5, 1, 2, 20)},
    "noise at a = 0.001": partial(floor, 96, 0.001),
    "noise of a very long cell": partial(floor, 384, 0.01, 480),
    "ranks": ranks,
    "limit of the step, long": partial(at_the_limit, 1_000_000),
    "drift": partial(drift, 1_000_000, stride=10),
    "where the drift comes from": drift_order,
    "seed of TR on L": instability,
    "energy of a struck chain, a million steps": partial(energy, 50_000.0),
    "energy of a struck sheet, long": partial(struck_sheets.energy, 10_000.0),
    "a chain of 1e5": partial(long_chain, 100_000, 20.0),
    "a breather, long": partial(breathes, 2000),
    "a plate": partial(space.wave, "plate of 12 layers on a substrate", duration=3.0),
    "antiresonance, long": at_the_antiresonance,
    "pulse, long": pulse,
    "spheres that leave their substrate for long": space.leaving,
    "parting velocity, four steps": parting,
    "a layer for a million steps": partial(space.kept, 1_000_000),
    "slopes at the resonance, long": partial(by_jax, "slopes", "growing", 0.2, 500.0),
    "slopes at the resonance, both ways": partial(by_jax, "slopes", "adjoint"),
    "energy of a network, a million steps": partial(by_jax, "lasting", "kept", 8, 4, 1_000_000),
    "energy of a network of 600": partial(by_jax, "lasting", "kept", 24, 25, 100_000),
    "energy of a network of 10 000": partial(by_jax, "lasting", "kept", 100, 100, 2000),
    "energy of a network with shear, long": partial(by_jax, "lasting", "kept", 8, 4, 300_000, 0.03, shear=True),
    "rounding of networks": partial(by_jax, "lasting", "rounded", [(8, 4), (24, 25)], [8000]),
    "rounding of a network over steps": partial(by_jax, "lasting", "rounded", [(8, 4)], [500, 4000, 32_000], 16),
}
