"""A scene in other units of mass, length and time: the same physics, its spheres from a nanometre to a metre.

A key says its unit (`granular_lmp.scene.schema.Rule`), so one that is added is scaled without a line here.
"""

import re
from collections.abc import Iterator
from itertools import product
from math import log10, prod, sqrt
from typing import Any

from granular_lmp import Scene
from granular_lmp.crystal.sphere_table import SphereTable
from granular_lmp.errors import SceneError
from granular_lmp.scene.start import COLUMNS, IN_SPACE

# Powers of mass, length and time in the units of keys
DIMENSIONS: dict[str, tuple[int, int, int]] = {
    "m": (0, 1, 0),
    "Pa": (1, -1, -2),
    "J/m2": (1, 0, -2),
    "kg/m3": (1, -3, 0),
    "N": (1, 1, -2),
    "N/m": (1, 0, -2),
    "N s/m": (1, 0, -1),
    "m/s": (0, 1, -1),
    "Hz": (0, 0, -1),
} | dict.fromkeys(
    ["", "rad", "degrees", "rad per row", "rows", "D0/Delta0", "tau", "t0", "rad/t0", "minutes"], (0, 0, 0)
)
TABLE = {"density": "kg/m3", "radius": "m"}
STATE = {"u": "m", "v": "m/s", "s": "Hz"}  # by the first letters of its columns
ALIKE = ((1.0, 1.0), (10.0, 0.1), (1e-4, 1e-2))  # factors of moduli and densities whose ratio is a power of 100
_NUMBER = re.compile(r"(?<![A-Za-z_\d.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_STYLES = re.compile(r"(?<=units )( *)(nano|micro|si)(: [\w, /]+)?")


def rescaled(scene: Scene, mass: float, length: float, time: float) -> Scene:
    """Return a scene whose numbers are those of another in units that are 1/mass, 1/length and 1/time as large."""
    tables = scene.to_dict()

    def times(value: Any, unit: str) -> Any:
        if isinstance(value, SphereTable):
            return {name: each * times(1.0, TABLE.get(name, "")) for name, each in value.columns.items()} or ""
        if unit == "SI units":
            units = ["", "", *(STATE[name[0]] for name in (COLUMNS + IN_SPACE)[2:])]
            return [[times(each, unit) for each, unit in zip(row, units, strict=False)] for row in value]
        powers = zip((mass, length, time), DIMENSIONS[unit], strict=True)
        factor = prod(size**power for size, power in powers)
        return value * factor if isinstance(value, float) else value

    for name in scene.layout.tables:
        units = {key.name: key.rule.unit for key in scene.keys_of(name)}

        def scaled(table: dict[str, Any], units: dict[str, str] = units) -> dict[str, Any]:
            return {key: times(value, units[key]) for key, value in table.items() if value is not None}

        if name in tables:
            held = tables[name]
            tables[name] = [scaled(each) for each in held] if name in scene.layout.repeated else scaled(held)
    return type(scene).from_dict(tables)


def sized(scene: Scene, *radii: float) -> Scene:
    """Return a scene with spheres of the first radius, m, at which moduli, densities and adhesion are allowed."""
    for radius, (modulus, density) in product(radii, ALIKE):
        length = radius / scene.sphere.radius
        try:
            return rescaled(scene, density * length**3, length, length * sqrt(density / modulus))
        except SceneError as error:
            if " a number in [" not in str(error):
                raise
    raise ValueError(f"{scene.name}: no radius of {radii} is allowed")


def sizes(scene: Scene) -> tuple[Scene, Scene]:
    """Return a scene with spheres of a nanometre and of a metre, or of ten and a tenth where the ranges of keys end."""
    return sized(scene, 1e-9, 1e-8), sized(scene, 1.0, 0.1)


def departures(one: str, other: str, share: float) -> Iterator[tuple[str, str]]:
    """Yield lines of two texts that differ in more than powers of ten of numbers, to a share, and names of units."""
    lines = ([" ".join(line.split()) for line in _STYLES.sub("", text).splitlines()] for text in (one, other))
    for both in zip(*lines, strict=True):
        words, numbers = zip(
            *((_NUMBER.split(line), [*map(float, _NUMBER.findall(line))]) for line in both), strict=True
        )
        if words[0] != words[1] or not all(_same(*pair, share) for pair in zip(*numbers, strict=True)):
            yield both


def _same(one: float, other: float, share: float) -> bool:
    if one * other <= 0:
        return one == other
    power = log10(one / other)
    return abs(power - round(power)) < share
