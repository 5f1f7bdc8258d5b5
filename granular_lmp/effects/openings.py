"""Lines of a deck that begin contacts at rest, and that count the contacts that have opened or formed since.

LAMMPS begins and counts contacts that end at overlap 0, sphere by sphere (``contact/atom``). Contacts that adhere
beyond overlap 0 (`AdhesionLaw.beyond`) it begins at overlap 0 and does not count. Therefore

* *at rest* all spheres are made wider for a moment, by more than any pull-off distance. All contacts begin, and those
  that do not exist at rest end when the spheres return to their size;
* *equal spheres* are counted within the pull-off distance, sphere by sphere;
* contacts of *unequal spheres* are counted by LAMMPS. For a pair without contact the components of the vector between
  the centres, from ``p10`` on, are 0, so contacts are pairs with a component beyond ±R/2. A histogram of three bins
  counts them along one axis or along all, as the crystal needs; for this LAMMPS computes the contacts again at each
  look. All spheres are counted, even if they cannot affect the record. A contact that forms at the same look as another
  opens cancels it. An open contact must return to overlap 0 before it forms again. If this takes longer than a look
  (`lingers`), no opening is missed, and a strongly pulled contact need not count as open.
"""

from functools import reduce

import numpy as np

from granular_lmp.crystal.search import overlapping
from granular_lmp.effects import on_walls
from granular_lmp.effects.between_looks import nearly_open
from granular_lmp.effects.guard import Prepared, watches_part
from granular_lmp.effects.reading import alike, judged_singly
from granular_lmp.rest.at_rest import law_at_rest
from granular_lmp.rest.looks import LOOKS
from granular_lmp.rest.scene import Scene

PULL_OFF = 1e-9  # share of a pull-off distance in which contacts are not counted, as a margin for rounding
WIDER = 1.2  # in largest pull-off distances, so that rounding does not leave out a contact
_NEAR = 0.2  # R: pairs with a larger gap at rest do not meet
_MAY = "; + 1 if a contact may have opened between looks"


def by_pairs(scene: Scene) -> bool:
    """Return whether the contacts in LAMMPS are counted: for unequal spheres that adhere beyond overlap 0."""
    return not scene.perfect and scene.sphere.pull_off_distance > 0 and not alike(scene)


def lingers(problem: Prepared) -> bool:
    """Return whether an oscillating contact that is just pulled off stays open for longer than a look.

    Around the overlap δ at rest it returns from the pull-off distance h to 0 within a phase of arccos(δ/(δ + h)).
    """
    deepest, reach = problem.rest.contacts.overlap.max(), problem.scene.sphere.pull_off_distance
    return bool(np.arccos(deepest / (deepest + reach)) > 2 * np.pi / LOOKS)


def begins_wider(problem: Prepared) -> bool:
    """Return whether LAMMPS does not begin some contact at rest by itself."""
    return by_pairs(problem.scene) and bool((problem.rest.contacts.overlap <= 0).any())


def begin(problem: Prepared) -> list[str]:
    """Return the block that begins all contacts at rest; empty if LAMMPS begins them by itself."""
    if not begins_wider(problem):
        return []
    reach = float(np.max(-law_at_rest(problem.scene).pull_off_overlap / problem.rest.contacts.radii))
    return [
        "# --- begin: LAMMPS begins contacts at overlap 0, but some adhere beyond: spheres are wider for a moment",
        "fix          own all store/state 0 diameter",
        "variable     own atom f_own",
        f"variable     wider atom f_own*{1 + WIDER * reach!r}",
        "set          group all diameter v_wider",
        "thermo_style custom step",
        "run          0 post no",
        "set          group all diameter v_own",
        "unfix        own",
    ]


def at_rest_lines(problem: Prepared) -> list[str]:
    """Return the lines that count the contacts of each sphere at rest, before the first run.

    LAMMPS counts them, so the numbers belong to the data file.
    """
    walls = on_walls.at_rest_lines(problem)
    if by_pairs(problem.scene):
        return walls
    sphere, count = problem.scene.sphere, "contact/atom"
    if sphere.pull_off_distance:
        reach = 2 * sphere.radius + sphere.pull_off_distance * (1 - PULL_OFF)
        count = f"coord/atom cutoff {problem.units.number(reach, length=1)!r}"
    return [f"compute      touching all {count}", "fix          at_rest all store/state 0 c_touching", *walls]


def changed_lines(problem: Prepared) -> list[str]:
    """Return the lines that count contacts that have opened or formed: the most of one sphere, or all by pairs.

    A contact that hardly touches counts as open, as it may open between two looks.
    """
    scene = problem.scene
    near = "" if judged_singly(scene) else f"({nearly_open(problem.rest):.4f}>v_overlap)"
    if not by_pairs(scene):
        missed = f"abs(f_at_rest-c_touching){on_walls.missed(problem)}{near and '+' + near}"
        return [
            f"variable     missed atom {missed}  # change in the contacts of a sphere{_MAY * bool(near)}",
            "compute      open inside reduce max v_missed",
        ]
    law, axes = scene.sphere.contact_law, _axes(problem)
    mark = law.mark(scene.space)
    off = [
        f"variable     off_{axis} equal abs(f_along_{axis}[1][2]+f_along_{axis}[3][2]-{count})"
        for axis, count in axes.items()
    ]
    most = reduce(lambda one, other: f"ternary({one}>{other},{one},{other})", (f"v_off_{axis}" for axis in axes))
    may = "" if lingers(problem) or not near else f"+(v_changed==0)*{near}"
    left, sums = on_walls.missed(problem)[1:], "compute      missing all reduce sum v_missed"
    return [
        "# contacts that existed at rest and do not now, or new contacts",
        *([f"variable     missed atom {left}", sums] if left else []),
        *([f"compute      pairs all pair/local{mark} cutoff {law.cutoff}"] if watches_part(scene) else []),
        *off,
        f"variable     changed equal {most}{'+c_missing' if left else ''}",
        f"variable     open equal v_changed{may}",
    ]


def counted_lines(problem: Prepared) -> list[str]:
    """Return the lines that count the contacts in LAMMPS at each look."""
    scene = problem.scene
    if not by_pairs(scene):
        return []
    # Bins are R wide. Pairs without contact are in the middle bin, and pairs farther than 1.5 R in the outer bins
    most = repr(1.5 * problem.units.number(scene.sphere.radius, length=1))
    # Columns of `contact_lines`, or of the pairs of all spheres
    column = "c_pairs[{}]" if watches_part(scene) else "c_contact[{}]"
    first = 1 if watches_part(scene) else 4
    return [
        f"fix          along_{axis} all ave/histo ${{look}} 1 ${{look}} -{most} {most} 3 "
        f"{column.format(first + 'xyz'.index(axis))} mode vector kind local beyond end"
        for axis in _axes(problem)
    ]


def _axes(problem: Prepared) -> dict[str, int]:
    """Return the axes along which contacts are counted, and the number with a component above R/2 along them at rest.

    One axis is enough if all contacts, and all pairs that may form one, have this component: x in a hexagonal lattice,
    y in a chain.
    """
    scene, contacts, wider = problem.scene, problem.rest.contacts, problem.rest.atoms.copy()
    wider.arrays["radius"] = wider.arrays["radius"] + _NEAR / 2
    near = np.abs(overlapping(wider)[2][:, : scene.space]) > 0.5
    counts = (np.abs(contacts.vector[~contacts.on_wall]) > scene.sphere.radius / 2).sum(axis=0)
    enough = np.flatnonzero(near.all(axis=0))[:1]
    return {"xyz"[axis]: int(counts[axis]) for axis in (enough if len(enough) else range(scene.space))}
