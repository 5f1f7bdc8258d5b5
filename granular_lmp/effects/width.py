"""Width: columns beyond the three that stand for any number where the spheres of a row all move alike."""

from granular_lmp.effects.effect import Case, Effect, Finding
from granular_lmp.effects.guard import BROKEN_SYMMETRY, ROUNDINGS, Guard
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.schema import AUTO

GUARD = Guard(
    title="row_spread",
    name="spread",
    lines=(
        "group        row id <centre_row>",
        "compute      most  row reduce max c_u[1] c_u[2]",
        "compute      least row reduce min c_u[1] c_u[2]",
        "variable     spread_looks vector (look(c_most[1])-look(c_least[1])+look(c_most[2])-look(c_least[2]))/v_D0"
        "  # in the centre row",
    ),
    limit=BROKEN_SYMMETRY,
    roundings=ROUNDINGS,
    meaning="D0 are between spheres of the centre row: the wave is no longer plane, and needs more packing.columns",
    cure="set packing.columns to more",
)


# Reasons against one column by effect that is on: its neighbour list is that of spheres at rest, and the forces at the
# start are those of the preload, whose velocities are not those of the wave
_NOT_IN_ONE_COLUMN = ("damping", "sliding", "contact_opening", "rolling", "twisting", "quiet_ends")


def called_for(case: Case) -> Finding:
    columns, fewest = float(case.scene.shape.columns), case.scene.lattice.fewest_columns
    if not case.scene.lattice.endless_rows:
        return Finding(False, columns, "column: a chain has no other")
    if case.scene.shape.single_column:
        return Finding(False, columns, "column stands for any number, on a neighbour list that is never renewed")
    if case.scene.uniform_rows:
        return Finding(False, columns, f"columns; {fewest} stand for any number where all of a row move alike")
    return Finding(True, columns, "columns; the spheres of a row do not move alike in this wave")


def loss(case: Case) -> str:
    return "waves whose rows do not move alike"


def refuse(case: Case) -> str:
    """Return why a single column cannot carry the scene, or ""."""
    scene = case.scene
    if not scene.shape.single_column:
        return ""
    effects = [name for name in _NOT_IN_ONE_COLUMN if case.on[name]]
    reasons = {
        f"no effect {' and '.join(effects)}": bool(effects),
        "a perfect crystal": not scene.perfect,
        "a plane wave along y": not scene.uniform_rows or scene.declared_vector.axis != "y",
        f'wave.form = "running" or "standing", not "{scene.wave.form}"': scene.wave.form not in ("running", "standing"),
        "no snapshots, output.particles = 0": scene.output.particles > 0,
        'no checkpoint, output.checkpoint = "auto"': scene.output.checkpoint != AUTO,
    }
    missing = [reason for reason, broken in reasons.items() if broken]
    return f"packing.columns = 1: needs {', '.join(missing)}; or take 3 columns" if missing else ""


def shows(scene: Scene) -> bool:
    """Return whether a row has spheres that could differ."""
    return not scene.shape.single_column


def declared(scene: Scene) -> bool:
    return scene.shape.columns > scene.lattice.fewest_columns or not scene.uniform_rows


WIDTH = Effect(
    "width",
    called_for,
    cost="columns",
    loss=loss,
    refuse=refuse,
    guard=GUARD,
    shows=shows,
    switch="packing.columns",
    declared=declared,
)
