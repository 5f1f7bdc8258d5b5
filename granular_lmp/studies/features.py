"""Features of scenes, each given by the settings of a user, and the scenes to which they are added.

A feature is added to a small scene without features. Settings of two features make one scene, unless they give two
values to one key. All places are in the first column, so that chains have them too.
"""

from collections.abc import Mapping
from typing import Any

from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.rest.scene import Scene

Settings = Mapping[str, Any]
FIXED = {"packing.ends": "fixed", "packing.rows": 37}  # fixed ends have an odd number of rows
PRESSED = {"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7}  # N, about that of adhesion
AT_REST = {"wave.form": "none"}
ADHERE = {"sphere.work_of_adhesion": 0.1}


def source(**how: Any) -> dict[str, Any]:
    """Return the settings of a source; all sources fit between quiet ends."""
    return {"source": [{"amplitude": 0.1} | how]}


WAVE: Settings = {
    "packing.rows": 36,
    "packing.columns": 6,
    "wave.amplitude": 0.02,
    "wave.wavenumber": 1.0471975511965976,  # π/3, which fits 36 rows
    "time.duration": 20.0,
    "time.allow_echo": True,
}
WAVES: dict[str, Settings] = {
    "chain": {"packing.lattice": "chain", "packing.columns": 1, "wave.mode": "L"},
    "square": {"packing.lattice": "square"},
    "radii": {"disorder.radius": 5e-5},
    "densities": {"disorder.density": 0.05},
    "vacancies": {"disorder.vacancies": 0.03, "disorder.seed": 2},  # others take a second to relax under a load
    "rows of another": {"inclusion": [{"rows": [10, 11], "density": 2500.0}]},
    "another sphere": {"inclusion": [{"spheres": [[14, 0]], "radius": 5.0005e-7}]},
    "jkr": {"sphere.adhesion_law": "jkr"},
    "hertz": PRESSED,
    "oblique": {"wave.direction": 30.0},
    "standing": {"wave.form": "standing"},
    "driven row": FIXED | {"wave.form": "driven"},
    "moved row": source(rows=[20, 20], motion="y", signal="burst"),
    "pushed sphere": source(spheres=[[22, 0]], force="y"),
    "torque": source(spheres=[[24, 0]], force="torque"),
    "packet": {"envelope.length": 5.0},
    "beam": {"envelope.width": 3.0, "packing.columns": 36},
    "fixed": FIXED,
    "quiet": FIXED
    | {"absorb.rows": 10, "absorb.reflection": 0.45}
    | AT_REST
    | source(rows=[18, 18], force="y", signal="tone"),
    "motion": {"monitor": [{"name": "motion", "rows": [16, 17]}]},
    "flux": {"monitor": [{"name": "flux", "rows": [18, 19], "what": "flux"}]},
    "viscosity": {"effects.viscosity": 1e-7},
    "restitution": PRESSED | {"effects.restitution": 0.95},
    "sliding": {"effects.sliding": True, "effects.friction": 0.5},
    "opening": {"effects.contact_opening": True},
    "rolling": {"effects.rolling_stiffness": 10.0, "effects.rolling_friction": 0.1},
    "incremental": {"effects.shear_law": "incremental"},
    "no shear": {"effects.shear": False},
    "no rotation": {"effects.rotation": False},
    "no tracking": {"effects.tracking": False},
    "tolerance": {"time.tolerance": 1e-2},
    "snapshots": {"output.particles": 1.0},
    "hertz scale": {"wave.frequency": 1.146e8},  # that of the wave number
    # of the other kind of scene
    "striker": {"striker": [{"rows": [4, 4], "velocity": 1e-3}]},
    "state": {"start.state": [[6, 0, 0.0, 0.0, 0.0, 1e-3, 0.0]]},
    # kinds of faces
    "free end": FIXED | {"packing.last": "free"},
    "free sides": {"packing.sides": "free"},
    "held sides": {"packing.sides": "held"},
    "finite sheet": FIXED | {"packing.first": "free", "packing.last": "free", "packing.sides": "free"},
    "chirp": source(spheres=[[23, 0]], force="y", signal="chirp"),
    "honeycomb": {"packing.lattice": "honeycomb", "wave.mode": 3},
    "quiet end": FIXED
    | {"packing.first": "free", "packing.last": "quiet", "absorb.rows": 10, "absorb.reflection": 0.45}
    | AT_REST
    | source(rows=[18, 18], force="y", signal="tone"),
    "wall end": FIXED | {"packing.last": "wall"},
    "stiffness spread": {"disorder.stiffness": 0.05},
    "pair stiffness": {
        "inclusion": [{"rows": [20, 21], "density": 2500.0}],
        "pair": [{"of": [0, 1], "normal_stiffness": 500.0}],
    },
    "table": {"packing.table": {"sphere": [12, 13], "density": [2500.0, 1900.0], "normal_stiffness": [1.2, 1.0]}},
}

IMPACT: Settings = {"packing.rows": 13, "packing.columns": 9, "striker.1.spheres": [[0, 0]], "time.duration": 6.0}
IMPACTS: dict[str, Settings] = {
    "chain": {"packing.lattice": "chain", "packing.columns": 1},
    "square": {"packing.lattice": "square"},
    "state": {"start.state": [[6, 0, 0.0, 0.0, 0.0, 0.5, 0.0]]},
    "displaced": {"start.state": [[6, 0, 0.0, 1e-7, 0.0, 0.0, 0.0]]},
    "held": {"packing.last": "held"},
    "wall": {"packing.last": "wall"},
    "periodic": {"packing.sides": "periodic"},
    "pressed": {"packing.contact_force": 10.0},
    "another radius": {"inclusion": [{"spheres": [[3, 0]], "radius": 0.004999999}]},
    "another density": {"inclusion": [{"rows": [8, 9], "density": 4000.0}]},
    "vacancy": {"inclusion": [{"spheres": [[5, 0]], "vacancy": True}]},
    "radii": {"disorder.radius": 1e-4},
    "friction": {"effects.friction": 0.3},
    "no rotation": {"effects.rotation": False},
    "restitution": {"effects.restitution": 0.9},
    "tolerance": {"time.tolerance": 1e-2},
    # of the other kind of scene
    "wave": {
        "wave.mode": "L",
        "wave.wavenumber": 1.0,
        "wave.amplitude": 0.02,
        **ADHERE,
        "packing.first": "free",
        "time.allow_echo": True,
    },
    "source": ADHERE | {"source": [{"spheres": [[7, 0]], "force": "y", "signal": "burst", "frequency": 1.0}]},
    "monitor": {"monitor": [{"name": "motion", "rows": [6, 7]}]},
    "quiet": ADHERE | {"absorb.rows": 3},
    "adhesion": ADHERE,
    "viscosity": {"effects.viscosity": 1e-3},
    "rolling": {"effects.rolling_stiffness": 10.0, "effects.rolling_friction": 0.1, "effects.friction": 0.3},
    # at rest under load
    "pressed sheet": {
        **{"packing.contact_force": 10.0, "packing.sides": "periodic"},
        **{"packing.first": "held", "packing.last": "held", "striker.1.spheres": [[4, 0]], "effects.friction": 0.3},
    },
    "jkr": ADHERE | {"sphere.adhesion_law": "jkr"},
    "cell": ADHERE | {"packing.ends": "periodic", "packing.sides": "periodic", "packing.rows": 14},
    # that meet
    "touching": ADHERE | {"start.touching": True},
    "forces": {"output.forces": True},
    "table": {"packing.table": {"sphere": [10, 11], "density": [7000.0, 9000.0]}},
}


@dataclass(frozen=True, eq=False)
class Kind:
    """Kind of scene to which features are added.

    Attributes
    ----------
    name : str
    words : str
        How its scenes differ from those of the other kind.
    shipped : str
        Name of the shipped scene.
    changes : mapping
        Settings that make it small.
    features : mapping
        Name of a feature → its settings.
    """

    name: str
    words: str
    shipped: str
    changes: Settings
    features: Mapping[str, Settings]

    @cached_property
    def scene(self) -> Scene:
        """Return the scene without features."""
        return Scene.load(self.shipped).with_values(self.changes)


KINDS = (
    Kind("waves", "with [wave]", "tr_periodic", WAVE, WAVES),
    Kind("impacts", "without [wave]", "point_impact", IMPACT, IMPACTS),
)
