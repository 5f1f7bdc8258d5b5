"""Kinds of monitors: what each records, its units, and how error estimates, exports and plots treat it.

A new kind is one entry here. `granular_lmp.runs.monitors` computes its quantities from motion and contacts. If it needs
a new kind of dump, `granular_lmp.lammps.monitors` writes the dump.
"""

from collections.abc import Mapping

from granular_lmp.frozen import dataclass
from granular_lmp.scene.schema import either


@dataclass(frozen=True)
class Unit:
    """Unit as powers of the units of force, displacement, time, radius and overlap, with its name in SI units."""

    si: str
    force: int = 0
    length: int = 0
    time: int = 0
    radius: int = 0
    overlap: int = 0

    def words(self, length: str, overlap: str, *, of_impact: bool) -> str:
        """Return the unit in words, "k1 D0^2/t0", given the names of the units of displacement and overlap.

        The unit of force is k1 of a contact at rest times the unit of displacement; in an impact it is m times the unit
        of displacement over t0².
        """
        powers = [
            ("m" if of_impact else "k1", self.force),
            (length, self.force + self.length),
            (overlap, self.overlap),
            ("R", self.radius),
            ("t0", self.time - 2 * self.force * of_impact),
        ]
        above = " ".join(name + f"^{power}" * (power > 1) for name, power in powers if power > 0)
        return above + "".join(f"/{name}" + f"^{-power}" * (power < -1) for name, power in powers if power < 0)


@dataclass(frozen=True)
class Quantity:
    """Number that is recorded for a sphere, a contact or a row at each sample.

    Attributes
    ----------
    meaning : str
    unit : Unit
    symbol : str
        Label in plots, where an angle is multiplied by R; "" if it is not drawn.
    product : tuple of str
        For a sum of products over a row: kinds of the factors, "rate" or "force", which determine its noise.
    """

    meaning: str
    unit: Unit
    symbol: str = ""
    product: tuple[str, ...] = ()


@dataclass(frozen=True)
class Kind:
    """Kind of monitor: what it records.

    Attributes
    ----------
    of : str
        What its numbers describe: "sphere", "contact", or "row" for whole rows.
    quantities : dict of str to Quantity
        Its numbers, by name. Quantities of motion have rates NAME_t too; vectors in space are NAME_x, NAME_y, NAME_z.
    contacts : bool
        True if contact forces are recorded beside the motion of the spheres.
    words : str
        Explanation in the note of the key; "" for the default.
    """

    of: str
    quantities: Mapping[str, Quantity]
    contacts: bool = False
    words: str = ""


_LENGTH, _ANGLE, _FORCE = Unit("m", length=1), Unit("rad", length=1, radius=-1), Unit("N", force=1)
POWER = Unit("W", force=1, length=1, time=-1)

KINDS = {
    "motion": Kind(
        "sphere",
        {
            **{u: Quantity(f"displacement along {x}", _LENGTH, f"${u}$") for u, x in zip("uvw", "xyz", strict=True)},
            "phi": Quantity("rotation about z, R theta", _ANGLE, r"$R\theta$"),
            **{f"phi{x}": Quantity(f"rotation about {x}, R theta", _ANGLE, rf"$R\theta_{x}$") for x in "xyz"},
        },
    ),
    "contacts": Kind(
        "contact",
        {
            "normal": Quantity("normal force of the contact, positive where it pushes", _FORCE, "normal force"),
            "shear": Quantity("shear force of the contact", _FORCE, "shear force"),
            "overlap": Quantity("overlap of the contact", Unit("m", overlap=1), "overlap"),
            "rolling": Quantity("rolling torque", Unit("Nm", force=1, radius=1)),
        },
        contacts=True,
        words="motion and contact forces",
    ),
    "flux": Kind(
        "row",
        {
            "flux": Quantity(
                "energy flux through the row, positive along +y", POWER, "flux along $y$", product=("rate", "force")
            )
        },
        contacts=True,
        words="the same for whole rows, for energy",
    ),
}
QUANTITIES = {name: quantity for kind in KINDS.values() for name, quantity in kind.quantities.items()}
OF_ROWS = {name: each for kind in KINDS.values() if kind.of == "row" for name, each in kind.quantities.items()}
MEANING = "; ".join(f"{name}: {kind.words}" for name, kind in KINDS.items() if kind.words)  # of the key
WITH_CONTACTS = either(name for name, kind in KINDS.items() if kind.contacts)
WITHOUT_CONTACTS = either(name for name, kind in KINDS.items() if not kind.contacts)


def quantity_of(column: str, known: Mapping[str, Quantity] = QUANTITIES) -> Quantity | None:
    """Return the quantity of a column NAME, NAME_t or NAME_x; None if the column is unknown."""
    return known.get(column.partition("_")[0])
