"""Width: columns beyond three; three stand for any number if all spheres of a row move alike."""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import centre, offsets, places
from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import Effect
from granular_lmp.effects.guard import BROKEN_SYMMETRY, ROUNDINGS, Guard, Prepared
from granular_lmp.rest.linear import uniform_rows
from granular_lmp.rest.scene import Scene


def spread(problem: Prepared) -> list[str]:
    """Return the line that measures the distance by which spheres of the centre row have moved apart."""
    first, *others = 1 + centre_row(problem)
    apart = "+".join(
        f"abs(C_u[{other}][{part}]-C_u[{first}][{part}])"
        for other in others
        for part in range(1, problem.scene.space + 1)
    )
    return [
        f"variable     spread equal ({apart})/$(v_D0:%.17g)  # distances in the centre row, in D0: 0 in a plane wave"
    ]


def centre_row(problem: Prepared) -> NDArray[np.int64]:
    """Return the indices of the spheres of the centre row.

    With several spheres per cell they are at the same place in the cell as the centre sphere; in layers shifted along y
    they are at the same height.
    """
    crystal, (_, along_y) = problem.rest.atoms, offsets(problem.rest.atoms)
    alike = (crystal.arrays["row"] == problem.scene.shape.centre_row) & (places(crystal) == 0)
    return np.flatnonzero(alike & np.isclose(along_y, along_y[centre(crystal)]))


def identifiers(row: NDArray[np.int64]) -> str:
    """Return ascending identifiers for ``group NAME id``: first, last and step, or one by one."""
    apart = sorted(
        set(np.diff(row).tolist())
    )  # np.unique would import numpy.ma, which takes a twentieth of a short command
    if len(apart) > 1:
        return " ".join(map(str, row))
    return f"{row[0]}:{row[-1]}" + "".join(f":{each}" for each in apart if each > 1)


def sideways(problem: Prepared) -> list[str]:
    """Return the lines that measure the largest distance of a sphere from the line of the chain."""
    return [
        "compute      aside inside reduce maxabs c_u[1]",
        "variable     sideways equal c_aside/$(v_D0:%.17g)  # in D0",
    ]


def _is_sheet(scene: Scene) -> bool:
    return scene.lattice.sheet


def _is_pressed_chain(scene: Scene) -> bool:
    return not scene.lattice.sheet and scene.packing.contact_force > 0


GUARD = Guard(
    title="row_spread",
    name="spread",
    lines=spread,
    limit=BROKEN_SYMMETRY,
    roundings=ROUNDINGS,
    meaning="in D0, the distance by which spheres of the centre row have moved apart: the wave is no longer plane",
    cure="set packing.columns to more",
    where=_is_sheet,
)

SIDEWAYS = Guard(
    title="largest_sideways",
    name="sideways",
    lines=sideways,
    limit=BROKEN_SYMMETRY,
    roundings=ROUNDINGS,
    meaning="in D0, the distance of a sphere from the line of the chain: the compressed chain buckles",
    cure="set a shorter time.duration, and push along y only",
    where=_is_pressed_chain,
)


def called_for(case: Case) -> Finding:
    columns, fewest = float(case.scene.shape.columns), case.scene.lattice.fewest_columns
    if not case.scene.lattice.sheet:
        return Finding(False, columns, "a chain has {} column")
    if "sides" in case.scene.shape.faces:
        return Finding(True, columns, f"{{}} columns are between sides that are {case.scene.shape.sides}")
    if uniform_rows(case.scene):
        return Finding(
            False,
            columns,
            f"all spheres of a row move alike, so {fewest} columns stand for any number; there are {{}}",
        )
    return Finding(True, columns, "the spheres of a row do not move alike in this wave; there are {} columns")


def loss(case: Case) -> str:
    return "waves whose rows do not move alike"


def declared(scene: Scene) -> bool:
    if _is_pressed_chain(scene):
        return False
    return scene.shape.columns > scene.lattice.fewest_columns or not uniform_rows(scene)


WIDTH = Effect(
    "width",
    called_for,
    cost="columns",
    loss=loss,
    guards=(GUARD, SIDEWAYS),
    switch="packing.columns",
    declared=declared,
    recorded=True,
)
