"""Readings of contacts with walls for guards: LAMMPS returns, for each sphere, whether it touches and the force.

A wall is named after its face, and its fix after the wall and the material of its spheres: ``zlo1``.
"""

import numpy as np

from granular_lmp.crystal.sphere import Sphere
from granular_lmp.effects.guard import Prepared
from granular_lmp.frozen import dataclass

# Walls by name: their normal axis, and the direction along it in which they push
FACES = {f"{axis}{end}": (number, way) for number, axis in enumerate("xyz") for end, way in (("lo", 1), ("hi", -1))}
_PRESSED = 1e-9  # Rounding leaves less than this share of the holding force if nothing presses


@dataclass(frozen=True)
class OnWall:
    """Readings of the contacts of one material with one wall, from the forces in LAMMPS on each sphere.

    Attributes
    ----------
    name : str
        Fix of the wall.
    inward : int
        1 if the wall pushes along its axis, −1 against it.
    sphere : Sphere
        Sphere of the lattice, which determines the law.
    holding_force, adhesive_force, dashpot, rest : float
        In units of the deck; `rest` is the push at rest.
    """

    name: str
    inward: int
    sphere: Sphere
    holding_force: float
    adhesive_force: float
    dashpot: float = 0.0
    rest: float = 0.0

    @property
    def face(self) -> str:
        """Name of the wall, a key of `FACES`."""
        return self.name[:3]

    @classmethod
    def all_of(cls, problem: Prepared) -> tuple["OnWall", ...]:
        """Return the walls of a problem, one for each face and material."""
        contacts, sphere, found = problem.rest.contacts, problem.scene.sphere, list[OnWall]()
        if not contacts.on_wall.any():
            return ()
        material = problem.rest.atoms.arrays.get("material", np.zeros(len(problem.rest.atoms), dtype=int))[contacts.i]
        dashpot = problem.scene.effects.viscosity if problem.scene.effects.damping is True else 0.0
        for face, (axis, inward) in FACES.items():
            for m in range(len(problem.rest.materials)):
                own = contacts.on_wall & (contacts.normals[:, axis] * inward < -0.5) & (material == m)
                if own.any():
                    adhesive, pressed = contacts.adhesive_force[own], contacts.contact_force[own]
                    forces = (
                        problem.units.number(float(each.min()), mass=1, length=1, time=-2)
                        for each in (adhesive + pressed, adhesive)
                    )
                    holding, pull = forces
                    rest = holding - pull if holding - pull > _PRESSED * holding else 0.0
                    loss = problem.units.number(dashpot, mass=1, time=-1)
                    found.append(cls(f"{face}{m + 1}", inward, sphere, holding, pull, loss, rest))
        return tuple(found)

    def lines(self) -> list[str]:
        """Return the lines that measure the smallest push and the largest shear force in the group inside."""
        least, axis = "min" if self.inward > 0 else "max", FACES[self.face][0]
        across = " ".join(f"f_{self.name}[{number + 2}]" for number in range(3) if number != axis)
        push, lines = f"f_{self.name}[{axis + 2}]", []
        if self.rest:  # spheres away from the wall have a force of 0, unlike any push at rest
            rest, at = repr(self.inward * self.rest), f"f_at_{self.face}"
            lines.append(f"variable     push_{self.name} atom {at}*{push}+(1-{at})*({rest})")
            push = f"v_push_{self.name}"
        lines += [
            f"compute      press_{self.name} inside reduce {least} {push}",
            f"compute      drag_{self.name} inside reduce maxabs {across}",
        ]
        if self.dashpot:
            lines.append(f"compute      lift_{self.name} inside reduce maxabs v{self.name[0]}")
        return lines

    def overlap(self) -> str:
        """Return the smallest overlap over that at rest, from the smallest push; a lower bound."""
        push = f"c_press_{self.name}" if self.inward > 0 else f"-c_press_{self.name}"
        if self.dashpot:
            push += f"-{self.dashpot!r}*c_lift_{self.name}"
        least = f"{push}+{self.adhesive_force!r}"
        share = f"(({least}>0)*({least})/{self.holding_force!r})"
        return self.sphere.contact_law.overlap_of_share(share, self.sphere.contact_force)

    def slip(self, friction: str) -> str:
        """Return the largest shear force over the sliding force of the weakest contact."""
        drag = "+".join(f"c_drag_{self.name}[{part}]^2" for part in (1, 2))
        left, load = f"v_left_{self.name}", self.sphere.contact_force
        rest = self.sphere.contact_law.above_pull_off(left, load, self.holding_force)
        return f"sqrt({drag})/({friction}*({self.adhesive_force!r}+{rest}))"


def fixes(problem: Prepared) -> dict[str, list[str]]:
    """Return the fixes of each wall, one for each material, by face."""
    found: dict[str, list[str]] = {}
    for each in OnWall.all_of(problem):
        found.setdefault(each.face, []).append(each.name)
    return found


def at_rest_lines(problem: Prepared) -> list[str]:
    """Return the lines that store which spheres touch a wall at rest."""
    lines = []
    for face in fixes(problem):
        place = problem.units.number(problem.rest.planes[face] * problem.scene.sphere.radius, length=1)
        gap = f"{face[0]}-({place!r})" if FACES[face][1] > 0 else f"({place!r})-{face[0]}"
        lines += [
            f"variable     rests_{face} atom radius>{gap}",
            f"fix          at_{face} all store/state 0 v_rests_{face}",
        ]
    return lines


def missed(problem: Prepared) -> str:
    """Return a term "+abs(...)" for each wall, which is 1 for a sphere that has left or reached it; or ""."""
    terms = ("-".join([f"f_at_{face}", *(f"f_{name}[1]" for name in names)]) for face, names in fixes(problem).items())
    return "".join(f"+abs({term})" for term in terms)
