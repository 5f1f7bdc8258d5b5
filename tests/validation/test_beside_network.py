"""Every sphere of scenes of every part, and of parts that stand in one scene, in LAMMPS and in the network.

One property for a registry of scenes: what the extrapolated run departs by from the network of its first snapshot, and
that each network which differs in one thing is seen.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.harmonic import by_cell
from granular_analysis.measure.reference import SLIDING_STEP
from granular_analysis.measure.signals import IN_SPACE as SIGNALS_IN_SPACE
from granular_analysis.measure.snapshot import FirstSnapshot, first_snapshot
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import present
from granular_analysis.theory.network_tangents import combined
from granular_analysis.tools.compare import compare, table
from granular_lmp import Scene, build, run
from granular_lmp.crystal.balance import BALANCED
from granular_lmp.problem import prepare
from tests.beside_network import STEPS, changed, departure, extrapolated, network_fields, times_of
from tests.conftest import PAPER, members
from tests.instance import silent_lammps

Values = dict[str, Any]
SPEED = PAPER.scale.velocity
STEEL = {"density": 7850.0, "youngs_modulus": 210e9, "poisson_ratio": 0.3, "work_of_adhesion": 0.1}
JKR = {"sphere.adhesion_law": "jkr"}
SPREAD = {"disorder.radius": 5e-5, "disorder.density": 0.1, "disorder.vacancies": 0.03}
HERTZ = {"sphere.work_of_adhesion": 0.0}
CHAIN = {"packing.lattice": "chain", "packing.columns": 1}
SQUARE = {"packing.lattice": "square", "packing.columns": 4}
PRESSED_CHAIN = CHAIN | HERTZ | {"wave.mode": "L", "packing.contact_force": 1e-7}
SILICA = {"youngs_modulus": 73e9, "poisson_ratio": 0.17, "work_of_adhesion": 0.063}
MEASURED = {
    "contact.normal_stiffness": 300.0,
    "contact.shear_stiffness": 200.0,
    "substrate.normal_stiffness": 900.0,
    "substrate.shear_stiffness": 500.0,
}


@dataclass(frozen=True)
class Beside:
    """A scene that is run with two steps, the relative departure that they leave, and a network that is another one.

    Fourth order in the step leaves 1e-7 where contacts stick, stay closed and have no dashpots. Where contacts open and
    close an error of h^{5/2} is left. With dashpots, and with friction under the incremental law, the error is of first
    order, and second order is left.
    """

    scene: Scene
    within: float = 2e-6
    steps: tuple[float, float] = STEPS
    order: int = 2
    other: Values = field(default_factory=dict)


# --- waves in a sheet, and what stands beside them ---

WAVE = PAPER.with_values(
    {"packing.rows": 24, "packing.columns": 8, "packing.ends": "periodic", "wave.wavenumber": np.pi / 3}
    | {"wave.amplitude": 0.02, "time.allow_echo": True, "name": "mixed"}
    | {"time.duration": 12.0, "time.sample": 1.0, "output.particles": 1.0}
)
REST = {"wave.form": "none"}
PULSE = {"rows": [4, 4], "force": "x", "signal": "burst", "cycles": 2.0, "frequency": 0.8, "amplitude": 0.3}
QUIET = REST | {"packing.ends": "fixed", "packing.rows": 25, "wave.mode": "L", "wave.wavenumber": 1.5}
QUIET |= {"absorb.rows": 8, "absorb.reflection": 0.45}
QUIET |= {"time.duration": 90.0, "time.sample": 5.0, "output.particles": 5.0}
INWARD = PULSE | {"rows": [12, 12], "force": "y", "cycles": 4.0, "frequency": 0.5}  # the top of the band is 0.71
BURST = {"signal": "burst", "cycles": 4.0, "frequency": 0.9}
MOVED = [[5, 4, 0.01 * PAPER.scale.length, -0.005 * PAPER.scale.length, 0.0, 0.01 * SPEED, 0.01 * SPEED / 5e-7]]
STRUCK = {"striker": [{"spheres": [[12, 4]], "velocity": 0.02 * SPEED, "direction": 30.0}]}
WAVES: dict[str, Values] = {
    "a heavy sphere": {"inclusion": [{"spheres": [[8, 7]], "density": 22000.0}]},
    "rows of steel": {"inclusion": [{"rows": [8, 11]} | STEEL]},
    "radii, s = 0.3": {"disorder.radius": 0.3 * PAPER.sphere.overlap_ratio},
    "a striker on a disordered adhesive sheet": REST
    | SPREAD
    | STRUCK
    | {"monitor": [{"name": "line", "rows": [15, 15]}]},
    "a wave and a striker": STRUCK,
    "a state on a wave": {"start.state": MOVED},
    "a striker beside a packet": {"wave.wavenumber": 1.9, "envelope.length": 3.0} | STRUCK,
    "a source on a standing wave": {"wave.form": "standing", "source": [PULSE]},
    "a source on a driven wave": {"packing.ends": "fixed", "packing.rows": 13, "packing.columns": 4}
    | {"wave.form": "driven", "envelope.ramp": 5.0, "source": [PULSE]},
    "a pulse from a source on a packet": {"wave.wavenumber": 1.9, "envelope.length": 3.0, "source": [PULSE]},
    "quiet ends of a square sheet": QUIET | {"packing.lattice": "square", "packing.columns": 4, "source": [INWARD]},
    "quiet ends of a chain": QUIET | CHAIN | {"source": [INWARD]},
    "a JKR crystal with a spread of radii": JKR | {"disorder.radius": 3e-5},
    **{f"{mode} in a square sheet": SQUARE | {"wave.mode": mode} for mode in ("L", "TR", "RT")},
    **{f"{mode} in a chain": CHAIN | {"wave.mode": mode} for mode in ("L", "RT")},
    "a heavy sphere in a square sheet": SQUARE | {"inclusion": [{"spheres": [[3, 1]], "density": 20000.0}]},
    "a compressed chain": PRESSED_CHAIN,
    "a compressed chain of unequal radii": PRESSED_CHAIN | {"disorder.radius": 1e-5},
    "a compressed chain with heavy rows": PRESSED_CHAIN | {"inclusion": [{"rows": [2, 3], "density": 4000.0}]},
    "a compressed chain that is struck": PRESSED_CHAIN | {"striker": [{"spheres": [[1, 0]], "velocity": 0.02 * SPEED}]},
    "a source at the corner of a finite sheet": REST
    | {"packing.ends": "fixed", "packing.rows": 9, "packing.columns": 7}
    | {"packing.first": "free", "packing.last": "free", "packing.sides": "free"}
    | {"source": [BURST | {"spheres": [[0, 0]], "force": "x"}]},
    "a torque, a motion and a rotation": REST
    | {
        "source": [
            {"spheres": [[6, 2]], "force": "torque"} | BURST,
            {"spheres": [[12, 5]], "motion": "x", "amplitude": 0.4, "signal": "ricker", "frequency": 0.9},
            {"spheres": [[18, 1]], "motion": "rotation", "frequency": 0.7, "ramp": 5.0, "delay": 2.0},
            {"spheres": [[3, 6]], "force": "y", "signal": "step", "ramp": 6.0},
            {"spheres": [[20, 6]], "force": "y", "signal": "chirp", "frequency": 0.6, "sweep": 2.0},
        ]
    },
    "samples in a disordered crystal": REST
    | SPREAD
    | {"source": [{"spheres": [[12, 4]], "force": "y", "delay": 1.0}]}
    | {"source.1.signal": [[n / 4, float(np.exp(-((n / 4 - 4) ** 2)) - np.exp(-16)) if n else 0.0] for n in range(81)]},
}
SLIDING = WAVE.with_values(
    {"packing.columns": 6, "disorder.vacancies": 0.02, "wave.amplitude": 0.2, "time.duration": 1.5, "time.sample": 0.5}
    | {"effects.sliding": True, "effects.friction": 0.03, "output.particles": 0.5}
)

# --- waves in crystals by the JKR law, whose contacts may be pulled beyond an overlap of 0 at rest ---

STRETCHED = JKR | {"packing.columns": 6, "time.duration": 3.0, "output.particles": 3.0, "disorder.radius": 1.5e-4}
FILLED = {"rows": [10, 11], "density": 2500.0, "youngs_modulus": 60e9, "work_of_adhesion": 0.05}
BY_JKR: dict[str, Values] = {
    "radii by JKR": STRETCHED | {"disorder.radius": 5e-5},
    "densities by JKR": STRETCHED | {"disorder.radius": 0.0, "disorder.density": 0.05},
    "vacancies by JKR": STRETCHED | {"disorder.radius": 0.0, "disorder.vacancies": 0.03, "disorder.seed": 2},
    "rows of another by JKR": STRETCHED
    | {"disorder.radius": 0.0, "inclusion": [{"rows": [10, 11], "density": 2500.0}]},
    "another sphere by JKR": STRETCHED
    | {"disorder.radius": 0.0, "inclusion": [{"spheres": [[14, 0]], "radius": 5.0005e-7}]},
    "two materials, stretched": STRETCHED | {"inclusion": [FILLED], "effects.contact_opening": True},
    "a chain, stretched": STRETCHED | CHAIN | {"wave.mode": "L", "disorder.radius": 3e-5},
    "compressed, stretched": STRETCHED | {"packing.contact_force": 5e-8},
    "relaxed with friction, stretched": STRETCHED | {"packing.relax_friction": 0.3},
    "incremental, standing and struck, stretched": STRETCHED
    | {"effects.shear_law": "incremental", "wave.form": "standing", "striker": [{"rows": [4, 4], "velocity": 1e-3}]},
}

# --- waves in crystals of other stiffnesses, by pair of kinds and with a spread ---

IN_TURN = {"inclusion": [{"rows": [0, 23], "every": 2, "density": 2500.0}]}
OF_PAIRS = [{"of": [1, 0], "normal_stiffness": 700.0}, {"of": [1, 1], "shear_stiffness": 300.0}]
STIFF: dict[str, Values] = {
    "a spread of stiffness": {"disorder.stiffness": 0.1},
    "pairs and a spread of stiffness": IN_TURN
    | {"pair": OF_PAIRS, "disorder.stiffness": 0.05, "inclusion.1.youngs_modulus": 9e10},
    "a spread of stiffness by JKR": JKR | {"disorder.stiffness": 0.1},
    # The last classes of the other material have no sphere
    "single spheres in a spread of stiffness": {"disorder.stiffness": 0.05}
    | {"inclusion": [{"spheres": [[20, 0], [2, 1]], "work_of_adhesion": 0.07}]},
    "a normal stiffness under a load": HERTZ | {"packing.contact_force": 1e-7, "contact.normal_stiffness": 700.0},
}

# --- strikes alone in crystals at rest under load ---

STRIKE = Scene.from_dict(
    {
        "name": "struck",
        "sphere": PAPER.to_dict()["sphere"],
        "packing": {"lattice": "hexagonal", "rows": 13, "columns": 9},
        "time": {"duration": 8.0, "sample": 1.0},
        "striker": [{"spheres": [[6, 4]], "velocity": 1e-3, "direction": 30.0}],
    }
)
STILL = {"packing.first": "held", "packing.last": "held", "packing.sides": "periodic"}
PUSH = {"spheres": [[6, 4]], "force": "y", "amplitude": 0.02}
STRIKES: dict[str, Values] = {
    "free sheet": {},
    "held sheet": STILL | {"packing.sides": "held"},
    "even rows": {"packing.rows": 12},
    "periodic cell": {"packing.rows": 12, "packing.ends": "periodic", "packing.sides": "periodic"},
    "square": {"packing.lattice": "square"},
    "chain": CHAIN | {"striker.1.spheres": [[6, 0]], "striker.1.direction": "y"},
    "disorder": SPREAD,
    "jkr": JKR | SPREAD,
    "inclusions": {"inclusion": [{"spheres": [[3, 2]], "density": 4e3}, {"spheres": [[4, 2]], "radius": 5.001e-7}]},
    "state": {"striker": [], "start.state": [[5, 4, 1e-12, 2e-12, 1e-3, 0.0, 100.0]]},
    "noise": {"start.noise": 1e-3},
    "pressed": STILL | HERTZ | {"packing.contact_force": 1e-7},
    "source alone": {"striker": [], "source": [PUSH | {"signal": "burst", "frequency": 0.5}]},
    "source": {"source": [PUSH | {"signal": "step"}], "monitor": [{"name": "m", "rows": [4, 5], "what": "flux"}]},
    "moved and turned": {
        "striker": [],
        "source": [
            {"spheres": [[6, 4]], "motion": "y", "amplitude": 0.02, "signal": "burst", "frequency": 0.5},
            {"spheres": [[3, 2]], "motion": "rotation", "amplitude": 0.02, "signal": "burst", "frequency": 0.5},
        ],
    },
    "quiet ends": STILL
    | {"striker": [], "packing.rows": 37, "absorb.rows": 10, "absorb.reflection": 0.45}
    | {"source": [{"rows": [18, 18], "force": "y", "amplitude": 0.02, "frequency": 0.5}], "time.duration": 20.0},
    "opening": {"striker.1.velocity": 5.0, "effects.friction": 0.3, "time.duration": 4.0},
    "viscosity": {"effects.viscosity": 1e-7},
    "no shear": {"effects.shear": False},
}

# --- strikes of spheres that just touch ---

IMPACT = Scene.load("point_impact").with_values(
    {"packing.rows": 7, "packing.columns": 7, "striker.1.spheres": [[0, 3]], "time.duration": 5.0, "time.sample": 0.5}
)
ROW = Scene.load("compressed_chain").with_values({"packing.rows": 24, "time.duration": 30.0, "time.sample": 0.5})
WALLS = {"packing.last": "wall", "packing.sides": "wall"}
DASHPOT = {"effects.viscosity": 0.1 * IMPACT.scale.mass / IMPACT.scale.time}
ROUGH = {"effects.friction": 0.3}
SECANT = ROUGH | {"effects.shear_law": "secant"}
LOOSE: dict[str, tuple[Scene, Values, float, int]] = {  # with the order of the error
    "a compressed chain with a wall": (ROW, {}, 1e-5, 2),
    "a compressed chain between held spheres": (ROW, {"packing.last": "held"}, 1e-5, 2),
    "a sheet between walls": (IMPACT, WALLS, 1e-5, 2),
    "a sheet between walls with friction": (IMPACT, WALLS | ROUGH, 3e-4, 1),
    "the same by the secant law": (IMPACT, WALLS | SECANT, 1e-4, 2),
    "a restitution in a sheet with a vacancy": (
        IMPACT,
        {"effects.restitution": 0.8, "inclusion": [{"spheres": [[4, 3]], "vacancy": True}]},
        3e-4,
        1,
    ),
    "gaps, vacancies and two materials": (
        IMPACT,
        {"disorder.radius": 1e-4, "disorder.density": 0.1}
        | {
            "inclusion": [
                {"rows": [5, 6], "density": 2700.0, "youngs_modulus": 7e10, "poisson_ratio": 0.33},
                {"spheres": [[2, 4]], "vacancy": True},
            ]
        },
        1e-5,
        2,
    ),
    "a state that moves and turns beside a striker, with friction": (
        IMPACT,
        SECANT | {"start.state": [[4, 3, 0.0, 0.0, 0.1, 0.2, 40.0]]},
        1e-3,
        2,
    ),
    "a displaced state with friction": (IMPACT, SECANT | {"start.state": [[4, 3, 1e-6, 2e-6, 0.1, 0.2, 0.0]]}, 1e-3, 2),
    "a displaced state": (IMPACT, {"start.state": [[4, 3, 1e-6, 2e-6, 0.1, 0.2, 0.0]]}, 1e-5, 2),
    "a free sheet": (IMPACT, {}, 1e-5, 2),
    "a struck cell without ends": (
        IMPACT,
        {"packing.rows": 8, "packing.sides": "periodic", "packing.ends": "periodic"},
        1e-5,
        2,
    ),
    "smaller spheres in a sheet": (
        IMPACT,
        {"inclusion": [{"spheres": [[3, 3]], "radius": 0.004998}, {"spheres": [[4, 2]], "radius": 0.0049}]},
        1e-5,
        2,
    ),
    # Gaps of 0.6 ℓ in the mean: spheres fly before they collide
    "gaps as wide as overlaps": (IMPACT, {"disorder.radius": 1e-3, "disorder.seed": 3}, 1e-5, 2),
    "a periodic sheet with friction": (IMPACT, {"packing.sides": "periodic"} | ROUGH, 3e-4, 1),
    "dashpots in a sheet with friction": (IMPACT, DASHPOT | ROUGH, 3e-4, 1),
    "dashpots in a chain": (ROW, DASHPOT | {"packing.rows": 12, "time.duration": 4.0}, 5e-5, 1),
    "dashpots in a chain of two masses": (
        Scene.load("dimer_chain"),
        DASHPOT | {"packing.rows": 9, "inclusion.1.rows": [1, 8], "time.duration": 4.0, "time.sample": 1.0},
        5e-5,
        1,
    ),
    "a breather": (Scene.load("breather"), {"time.duration": 10.0, "time.sample": 1.0}, 1e-4, 2),
    "two spheres collide": (ROW, {"packing.rows": 2, "packing.last": "free", "packing.contact_force": 0.0}, 1e-4, 2),
}

# --- a layer on a substrate, without a wave ---

LAYER: dict[str, Any] = {
    "name": "layer",
    "sphere": {"radius": 5e-7, "density": 2200.0, **SILICA},
    "packing": {"lattice": "hexagonal", "rows": 8, "columns": 5, "ends": "periodic", "sides": "periodic"},
    "substrate": SILICA,
    "time": {"duration": 5.0, "sample": 0.5},
}
UP = {"striker": [{"spheres": [[4, 3]], "velocity": 1e-3, "direction": "z"}]}
ALONG = {"striker": [{"rows": [0, 0], "velocity": 1e-3}]}
STATE = {"start": {"state": [[4, 3, 1e-12, 0.0, 0.0, 1e-3, 500.0, 2e-12, -1e-3, 1000.0, 2000.0]]}}
TORQUE = {"source": [{"spheres": [[2, 2]], "force": "torque_x", "signal": "tone", "frequency": 0.8, "amplitude": 0.1}]}
SHAKEN = {"source": [{"spheres": [[2, 2]], "force": "z", "signal": "burst", "frequency": 1.6, "amplitude": 0.1}]}


def layer(**tables: Any) -> Scene:
    """Return the scene of the layer with some tables; keys join those of a table that is there, None leaves it out."""
    joined = {name: LAYER.get(name, {}) | table if isinstance(table, dict) else table for name, table in tables.items()}
    return Scene.from_dict({name: table for name, table in (LAYER | joined).items() if table is not None})


LAYERS = {
    "struck from above": layer(**UP),
    "struck along y at a free end": layer(
        packing={"rows": 9, "ends": "fixed", "first": "free", "last": "held", "sides": "free"}, **ALONG
    ),
    "a state in space": layer(**STATE),
    "noise in space": layer(start={"noise": 1e-3, "seed": 3}),
    "pushed": layer(**SHAKEN),
    "turned, struck": layer(**TORQUE, **UP),
    "a struck chain on a substrate": layer(
        packing={"lattice": "chain", "rows": 15, "columns": 1, "ends": "fixed", "sides": "free"}, **ALONG
    ),
    "honeycomb": layer(packing={"lattice": "honeycomb", "columns": 8}, **UP),
    "with vacancies": layer(disorder={"vacancies": 0.1, "density": 0.1, "seed": 2}, **UP),
    "by the JKR law": layer(sphere={"adhesion_law": "jkr"}, **UP),
}

# --- waves in space ---

SIZE: Values = {"packing.rows": 8, "packing.columns": 6, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4}
SIZE |= {"time.duration": 3.0, "time.sample": 1.0, "time.allow_echo": True, "output.particles": 3.0}
AS_SHIPPED: Values = {"time.duration": 5.0, "output.particles": 5.0}
RADII = {"disorder.radius": 5e-5}  # s = 0.2
BULK = {"packing.layers": 4, "packing.columns": 4}
PRESSED = HERTZ | {"packing.contact_force": 1e-7}
FIXED = {"packing.ends": "fixed", "packing.rows": 9}
WALLED = {"packing.first": "wall", "packing.last": "wall", "packing.sides": "wall"}
OPEN = {"packing.first": "free", "packing.last": "free", "packing.sides": "free"}
BOTH = {"substrate.sides": "both"}
SHAKE = {"rows": [14, 14], "frequency": 1.0}
IN_SPACE: dict[str, tuple[str, Values]] = {
    "a vertical wave": ("monolayer_vertical", AS_SHIPPED),
    "a rocking wave": ("monolayer_rocking", AS_SHIPPED),
    "a layer with a spread of stiffness": ("monolayer_rocking", AS_SHIPPED | {"disorder.stiffness": 0.1}),
    "measured stiffnesses": ("monolayer_rocking", AS_SHIPPED | MEASURED),
    "a soft substrate": (
        "monolayer_rocking",
        AS_SHIPPED | {"substrate.youngs_modulus": 3e9, "substrate.poisson_ratio": 0.4},
    ),
    "square between two, JKR": (
        "monolayer_rocking",
        AS_SHIPPED | JKR | BOTH | {"packing.lattice": "square", "wave.mode": "2"},
    ),
    "a wave in honeycomb": (
        "monolayer_rocking",
        AS_SHIPPED | {"packing.lattice": "honeycomb", "packing.columns": 4, "wave.mode": "4"},
    ),
    "an oblique wave": (
        "monolayer_rocking",
        AS_SHIPPED | {"wave.direction": 50.0, "wave.mode": "3", "wave.wavenumber": 0.4},
    ),
    "a standing wave": ("monolayer_rocking", AS_SHIPPED | {"wave.form": "standing"}),
    "dashpots in space": ("monolayer_rocking", AS_SHIPPED | {"effects.viscosity": 1e-7}),
    "a push along z": ("monolayer_rocking", AS_SHIPPED | {"source": [SHAKE | {"force": "z", "amplitude": 0.3}]}),
    "a torque about x": (
        "monolayer_rocking",
        AS_SHIPPED | {"source": [SHAKE | {"force": "torque_x", "amplitude": 0.01}]},
    ),
    "a sheet without a substrate": ("tr_periodic", AS_SHIPPED | {"packing.space": 3}),
    "fcc, incremental": ("fcc_transverse", AS_SHIPPED | {"effects.shear_law": "incremental"}),
    "a film of equal spheres": ("multilayer", AS_SHIPPED),
    "a layer that lost contacts": ("monolayer_rocking", SIZE | {"disorder.radius": 3e-4}),
    "a layer of 1 % spheres": ("monolayer_rocking", SIZE | {"disorder.radius": 1e-2}),
    "a layer of every imperfection": (
        "monolayer_rocking",
        SIZE | RADII | {"disorder.density": 0.05, "disorder.vacancies": 0.05},
    ),
    "a layer of JKR spheres": ("monolayer_rocking", SIZE | RADII | JKR),
    "a layer with measured stiffnesses": ("monolayer_rocking", SIZE | RADII | MEASURED),
    "a layer between held rows": ("monolayer_rocking", SIZE | RADII | FIXED),
    "a layer in a box": ("monolayer_rocking", SIZE | FIXED | WALLED),
    "an unequal layer in a box": ("monolayer_rocking", SIZE | RADII | FIXED | WALLED),
    "an island": ("monolayer_rocking", SIZE | RADII | FIXED | OPEN),
    "a layer that is pressed together": ("monolayer_rocking", SIZE | RADII | {"packing.contact_force": 1e-8}),
    "a layer between two plates": ("monolayer_rocking", SIZE | RADII | BOTH),
    "a larger sphere": ("monolayer_rocking", SIZE | {"inclusion": [{"spheres": [[4, 3]], "radius": 5.001e-7}]}),
    "rows of steel on a substrate": ("monolayer_rocking", SIZE | {"inclusion": [{"rows": [0, 3], **STEEL}]}),
    "a chain on a substrate": ("monolayer_rocking", SIZE | RADII | CHAIN | {"wave.mode": "3"}),
    "a honeycomb": ("monolayer_rocking", SIZE | RADII | {"packing.lattice": "honeycomb", "wave.mode": "4"}),
    "fcc": ("fcc_transverse", SIZE | RADII | BULK),
    "fcc of JKR spheres": ("fcc_transverse", SIZE | RADII | BULK | JKR),
    "fcc under load": ("fcc_transverse", SIZE | RADII | BULK | PRESSED),
    "fcc with vacancies under load": ("fcc_transverse", SIZE | BULK | PRESSED | {"disorder.vacancies": 0.03}),
    "hcp": ("hcp_c_axis", SIZE | RADII | BULK),
    "rows of steel in hcp": ("hcp_c_axis", SIZE | BULK | {"inclusion": [{"rows": [0, 3], **STEEL}]}),
    "a film": ("multilayer", SIZE | RADII),
    "spheres on three others": (
        "multilayer",
        SIZE
        | RADII
        | {"packing.orientation": "[11-2]", "packing.layers": 2}
        | {"inclusion": [{"layers": [1, 1], "share": 0.6, "vacancy": True}]},
    ),
    "a cover of steel": ("multilayer", SIZE | {"inclusion": [{"layers": [1, 1], **STEEL}]}),
    "a film between two plates": ("multilayer", SIZE | RADII | BOTH),
}


def _all() -> Iterator[tuple[str, Beside]]:
    """Yield all cases by name."""
    yield from ((name, Beside(WAVE.with_values(values))) for name, values in WAVES.items())
    yield "contacts that slide", Beside(SLIDING, 1e-5, (0.0125, 0.00625), other={"friction": 0.0303})
    yield from ((name, Beside(WAVE.with_values(values), 1e-5, (0.02, 0.01))) for name, values in BY_JKR.items())
    yield from ((name, Beside(WAVE.with_values(values))) for name, values in STIFF.items())
    # Contacts that open, and dashpots
    slow = {"opening": (5e-4, (0.0125, 0.00625), 2), "viscosity": (3e-5, (0.0125, 0.00625), 1)}
    for name, values in STRIKES.items():
        yield f"a strike: {name}", Beside(STRIKE.with_values(values), *slow.get(name, ()))
    for name, (scene, values, within, order) in LOOSE.items():
        yield name, Beside(scene.with_values(values), within, (0.01, 0.005), order)
    yield from ((f"a layer: {name}", Beside(scene, 1e-6, (0.02, 0.01))) for name, scene in LAYERS.items())
    for name, (shipped, values) in IN_SPACE.items():
        first = values.get("effects.viscosity", 0.0) > 0
        step = 0.005 if first or "effects.shear_law" in values else 0.02
        yield name, Beside(Scene.load(shipped).with_values(values), 1e-6, (step, step / 2), 1 if first else 2)


CASES = dict(_all())
# `make test` runs each of these with one more feature, or a similar case of another family
MORE = [
    *("a source on a standing wave", "a source on a driven wave"),
    *(
        "a heavy sphere",
        "quiet ends of a square sheet",
        "a JKR crystal with a spread of radii",
        "quiet ends of a chain",
    ),
    *("a wave and a striker", "a striker on a disordered adhesive sheet", "densities by JKR", "vacancies by JKR"),
    *("another sphere by JKR", "two materials, stretched", "relaxed with friction, stretched"),
    *(f"a strike: {name}" for name in ("jkr", "opening", "even rows", "held sheet", "source alone", "free sheet")),
    *("a compressed chain with a wall", "a restitution in a sheet with a vacancy", "the same by the secant law"),
    *("a compressed chain between held spheres", "a displaced state with friction", "two spheres collide"),
    *("a sheet between walls with friction", "a layer: struck along y at a free end", "a layer: noise in space"),
    *("a layer: a struck chain on a substrate", "a layer: with vacancies", "a vertical wave", "a rocking wave"),
    *("a soft substrate", "square between two, JKR", "an oblique wave", "a standing wave", "a film of equal spheres"),
    *("a push along z", "a wave in honeycomb", "a layer that lost contacts", "a layer of 1 % spheres", "an island"),
    *("a layer in a box", "a layer that is pressed together", "a larger sphere", "rows of steel on a substrate"),
    *("fcc", "fcc under load", "hcp", "a film", "a layer with measured stiffnesses", "a layer between held rows"),
    *("a layer between two plates", "a cover of steel", "fcc of JKR spheres", "rows of steel in hcp"),
    *("spheres on three others", "a honeycomb", "a striker beside a packet", "a spread of stiffness by JKR"),
    "a layer of JKR spheres",
]


def wrong(first: FirstSnapshot) -> Iterator[Values]:
    """Yield changes of a network by one thing that it has."""
    network, radius = first.network, first.network.radius
    yield {"density": 1.01 * network.density}
    if network.drives and (len(network.drives) > 1 or first.state.motion.any()):
        yield {"drives": network.drives[:-1]}
    if network.drag is not None:
        yield {"drag": None}
    if np.ptp(radius) > 0:
        # Deviations of a thousandth more
        yield {"radius": radius + 1e-3 * (radius - np.median(radius)) + 1e-7 * radius}
    if len(set(network.materials)) > 1:
        yield {"materials": network.materials[::-1]}
        yield {"shear_mixing": "lammps"}
    if network.viscosity:
        yield {"viscosity": 1.01 * network.viscosity}
    if np.ndim(network.factors) == 3:
        yield {"factors": 1.01 * network.factors - 0.01}
    elif np.any(network.factors != np.ones(2)) and network.walls:
        (wall,), (normal, shear) = network.walls, network.factors
        yield {"factors": (normal, 1.01 * shear)}
        yield {"walls": (wall._replace(factors=(1.01 * wall.factors[0], wall.factors[1])),)}
        yield {"walls": (wall._replace(factors=(wall.factors[0], 1.01 * wall.factors[1])),)}
        yield {"walls": (wall._replace(point=(0.0, 0.0, wall.point[2] + 1e-3 * first.length)),)}


@pytest.mark.parametrize("name", members(CASES, *MORE))
def test_every_sphere_moves_as_in_its_network_and_as_in_no_other(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    pair = extrapolated(case.scene, tmp_path, case.steps, case.order)
    first, tau = first_snapshot(pair.record), times_of(pair.record)
    longest = SLIDING_STEP if np.isfinite(first.network.friction) else np.inf
    assert departure(pair.fields, network_fields(first, tau, longest)) < case.within
    for changes in (*wrong(first), *([case.other] if case.other else [])):
        other = network_fields(changed(first, **changes), tau, 2 * longest, rtol=1e-6)
        assert departure(pair.fields, other) > 10 * case.within, changes
    if not first.network.drives and name in IN_SPACE:
        assert all(guard["quiet"] for guard in pair.record.info["guards"].values())


# --- at rest, on walls, and what a user sees ---


def forces_in_lammps(scene: Scene, folder: Path) -> np.ndarray:
    """Return the forces on the free spheres at rest in LAMMPS, (n, 3), in k1 Δ0."""
    deck, sphere = build(scene), scene.sphere
    deck.write(folder)
    until_rest, preload, _ = deck.input_text.partition("# --- preload")
    assert preload
    with silent_lammps() as lammps:
        lammps.command(f'variable data index "{folder / deck.data_name}"')
        lammps.commands_string(until_rest)
        lammps.commands_string("thermo_style custom step\nfix move all nve/noforce\nrun 0 post no\n")
        count = len(deck.packing)
        free = lammps.numpy.extract_atom("type")[:count] % 2 == 1
        forces = np.array(lammps.numpy.extract_atom("f")[:count][free])
    unit = deck.problem.units.number(sphere.normal_stiffness * sphere.static_overlap, mass=1, length=1, time=-2)
    return forces / unit


IN_PLANE = ["radii, s = 0.3", "rows of steel", "radii by JKR"]
UNEQUAL = [name for name, (_, values) in IN_SPACE.items() if values.items() >= {"time.duration": 3.0}.items()]
UNEQUAL += IN_PLANE


@pytest.mark.parametrize("name", members(UNEQUAL, *set(MORE) & set(UNEQUAL)))
def test_a_crystal_of_unequal_spheres_is_at_rest_in_lammps(name: str, tmp_path: Path) -> None:
    forces = forces_in_lammps(CASES[name].scene, tmp_path / "deck")
    assert len(forces)
    # Positions of up to 10 radii are rounded to 1e-15 radii, 4e-12 overlaps
    assert np.abs(forces).max() < BALANCED + 1e-10


def test_spheres_that_are_pushed_off_their_substrate_are_said() -> None:
    problem = prepare(CASES["a layer of 1 % spheres"].scene)
    lifted = problem.rest.crystal.equilibrium.lifted
    assert 0 < lifted == len(problem.rest.atoms) - problem.rest.contacts.on_wall.sum()
    assert any(said.startswith(f"{lifted} spheres do not touch their wall, from which") for said in problem.warnings())
    assert not prepare(CASES["a rocking wave"].scene).rest.crystal.remarks()


WALLS_OF = ("a vertical wave", "square between two, JKR", "a film of equal spheres", "dashpots in space")


@pytest.mark.parametrize("name", members(WALLS_OF, "a vertical wave", "a film of equal spheres"))
def test_forces_on_substrates_are_those_of_the_network(name: str, tmp_path: Path) -> None:
    """Each sphere pushes and drags its substrate as in the network, which no force from LAMMPS enters."""
    monitor = {"monitor": [{"name": "beside", "rows": [1, 2], "what": "contacts"}]}
    short = {"time.duration": 3.0, "output.particles": 3.0, "time.timestep": 1e-3}  # the wave is there from the start
    record = run(CASES[name].scene.with_values(short | monitor), tmp_path / "run")
    contacts, first = record.monitor("beside").contacts, first_snapshot(record)
    times = record.tau * first.time
    reached = integrate(first.network, first.state, times, spheres=[first.recorded]).final
    now, pairs, count = present(first.network, reached), reached.pairs, len(first.network.radius)
    unit = first.scales.stiffness * first.length
    faces = ["zlo" if wall.normal[2] < 0 else "zhi" for wall in first.network.walls]
    on = {
        (int(i), faces[j - count]): k
        for k, (i, j) in enumerate(zip(pairs.first, pairs.second, strict=True))
        if j >= count
    }
    at = [on[i, wall] for i, _, wall in contacts.pairs if wall]
    walls = contacts.wall != ""
    pushed = now.repulsion * np.array(now.normal) - np.array(combined(now.shear, now.tangents.along))
    expected, found = pushed[:, at].T / unit, contacts.force[-1, walls]
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()
    assert np.abs(found - 1.01 * expected).max() > 5e-3 * np.abs(expected).max()


def test_compare_takes_the_network_in_space_to_the_tolerance_and_a_cell_refuses_it(tmp_path: Path) -> None:
    record = run(CASES["a layer of JKR spheres"].scene.with_values({"time.tolerance": 1e-4}), tmp_path / "run")
    found = compare(record)
    assert found.theory == "network"
    assert max(each for each in found.error.values() if each is not None) < 1e-4
    assert all(name in table([found]) for name in SIGNALS_IN_SPACE)
    with pytest.raises(ValueError, match=r"leaves out "):
        by_cell(record)
