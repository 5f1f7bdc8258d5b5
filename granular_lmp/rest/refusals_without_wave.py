"""Refusals of scenes without ``[wave]``, mostly of spheres that are not held at rest."""

from math import sqrt

from granular_lmp.crystal.adhesion_laws import SKIN
from granular_lmp.crystal.lattices import CHAIN, FREE, HELD, HEXAGONAL, WALL
from granular_lmp.crystal.scale import DEEPEST, LARGEST_OVERLAP_RATIO
from granular_lmp.crystal.sphere_table import STIFFNESSES
from granular_lmp.rest.derived import Derived
from granular_lmp.rest.refusal import WITHOUT_WAVE, Refusal, joining
from granular_lmp.rest.refusals_at_rest import EPSILON
from granular_lmp.scene.places import place_troubles
from granular_lmp.scene.sections import DISTANCE, RESCALED
from granular_lmp.scene.strikers import leads
from granular_lmp.scene.without_wave import AT_REST, NOT_HELD

# ℓ over the rounding of the farthest position, at least; the error of velocities is then 1e-4 of the striker's
ROUNDINGS_IN_OVERLAP = 1e4
LARGEST_RATIO = 10.0  # largest ratio of radii in a chain
SMALLEST_IN_SHEET = 0.88  # in radii: the smallest sphere that the largest allowed disorder makes
LOOSEST = 0.04  # largest disorder.radius of a sheet: gaps of neighbours are then below a quarter of the radius


LINES: list[Refusal] = []
line = joining(LINES, of=(NOT_HELD,))


@line("physics", of=WITHOUT_WAVE)
def nothing_moves(scene: Derived) -> str:
    if scene.striker or scene.start.moves or scene.source:
        return ""
    return "striker: missing; an impact needs a table [[striker]], or a [start] in which a sphere moves"


@line("not built")
def held_sides(scene: Derived) -> str:
    if scene.packing.sides != HELD:
        return ""
    return f'packing.sides = "held": must be "free", "periodic" or "wall"; held sides need {AT_REST}'


@line("physics")
def touching_without_adhesion(scene: Derived) -> str:
    if not scene.start.touching or scene.material.work_of_adhesion and not scene.packing.contact_force:
        return ""
    return (
        "start.touching = true: needs sphere.work_of_adhesion above 0 and packing.contact_force = 0; spheres without "
        "adhesion just touch anyway, and compressed spheres cannot"
    )


@line("physics")
def restitution_of_adhesion(scene: Derived) -> str:
    restitution = scene.effects.restitution
    if restitution == 1 or not scene.material.work_of_adhesion:
        return ""
    return (
        f"effects.restitution = {restitution!r}: must be 1 with sphere.work_of_adhesion above 0; LAMMPS has it only "
        "for contacts without adhesion"
    )


@line("physics")
def adhesion_beyond_the_list(scene: Derived) -> str:
    further = scene.material.contact_law.later if scene.effects.parting == DISTANCE else 1.0
    reach = further * scene.material.pull_off_distance / scene.material.radius
    if reach <= SKIN:
        return ""
    return (
        f"sphere.work_of_adhesion = {scene.material.work_of_adhesion!r}: the contact would hold until {reach:.3g} "
        f"radii beyond overlap 0; must be at most {SKIN}, where the neighbour list of LAMMPS ends"
    )


@line("not built")
def late_parting_beside_walls(scene: Derived) -> str:
    if scene.effects.parting != DISTANCE or WALL not in (scene.packing.first, scene.packing.last, scene.packing.sides):
        return ""
    return f'effects.parting = "{DISTANCE}": must be "load" beside walls, which the kernel lacks'


@line("not built")
def late_parting_of_a_law_that_the_kernel_lacks(scene: Derived) -> str:
    if scene.effects.parting != DISTANCE or scene.effects.shear_law != RESCALED:
        return ""
    return f'effects.shear_law = "{RESCALED}": the kernel lacks it with effects.parting = "{DISTANCE}"; use another'


@line("physics")
def rolling_of_spheres_that_do_not_turn(scene: Derived) -> str:
    effects = scene.effects
    turn = effects.friction and effects.rotation is not False
    if effects.rolling is False or not (effects.rolling_stiffness or effects.rolling is True) or turn:
        return ""
    return (
        f"effects.rolling_stiffness = {effects.rolling_stiffness!r}: needs effects.friction above 0 and "
        "effects.rotation not false; otherwise nothing turns a sphere"
    )


@line("physics")
def rolling_without_a_law(scene: Derived) -> str:
    effects = scene.effects
    if effects.rolling is True and not effects.rolling_stiffness:
        return "effects.rolling = true: needs effects.rolling_stiffness above 0, N/m"
    if effects.rolling is not False and effects.rolling_stiffness and not effects.rolling_friction:
        return "effects.rolling_friction = 0.0: must be above 0 with effects.rolling on; it caps the rolling force"
    return ""


@line("not built")
def rolling_with_late_parting(scene: Derived) -> str:
    effects = scene.effects
    if effects.parting != DISTANCE or not effects.rolling_stiffness or effects.rolling is False:
        return ""
    return f'effects.parting = "{DISTANCE}": must be "load" with effects.rolling, which the kernel lacks'


@line("physics")
def friction_in_a_chain(scene: Derived) -> str:
    if scene.lattice != CHAIN or not scene.effects.friction:
        return ""
    return f"effects.friction = {scene.effects.friction!r}: must be 0 in a chain, where nothing is sheared"


@line("not built")
def inclusion_that_adheres(scene: Derived) -> str:
    if scene.start.touching:
        return ""
    found = (
        f"inclusion {number}: work_of_adhesion = {each.work_of_adhesion!r}: must be left out"
        for number, each in enumerate(scene.inclusion, 1)
        if each.work_of_adhesion
    )
    return next(found, "")


def _radius_outside(scene: Derived, low: float, high: float) -> str:
    """Return the first radius of an inclusion or a table that is not from `low` to `high` times the usual one.

    It is "" if there is none.
    """
    radius = scene.sphere.radius
    declared = [(f"inclusion {number}", each.radius) for number, each in enumerate(scene.inclusion, 1) if each.radius]
    declared += [("packing.table", each) for each in scene.packing.table.extremes("radius")]
    found = (f"{where}: radius = {each!r}" for where, each in declared if not low * radius <= each <= high * radius)
    return next(found, "")


@line("physics")
def table_of_stiffnesses(scene: Derived) -> str:
    factors = [name for name in STIFFNESSES if name in scene.packing.table.columns]
    if not factors:
        return ""
    return f"packing.table: {factors[0]}: scales stiffnesses at rest under load; needs {AT_REST}"


@line("physics")
def larger_sphere_in_a_sheet(scene: Derived) -> str:
    found = _radius_outside(scene, 0.0, 1.0)
    if scene.lattice == CHAIN or not found:
        return ""
    return (
        f"{found}: must be at most sphere.radius = {scene.sphere.radius!r} in a sheet, which has no room for a larger "
        "sphere; let [sphere] be the largest, and an [[inclusion]] the others"
    )


@line("not built")
def much_smaller_sphere_in_a_sheet(scene: Derived) -> str:
    found = _radius_outside(scene, SMALLEST_IN_SHEET, 1.0)
    if scene.lattice == CHAIN or not found:
        return ""
    return (
        f"{found}: must be from {SMALLEST_IN_SHEET} to 1 times sphere.radius = {scene.sphere.radius!r} in a sheet; a "
        "smaller sphere may pass its neighbours"
    )


@line("physics")
def spheres_of_other_sizes(scene: Derived) -> str:
    found = _radius_outside(scene, 1 / LARGEST_RATIO, LARGEST_RATIO)
    if not found:
        return ""
    return (
        f"{found}: must be from {1 / LARGEST_RATIO:g} to {LARGEST_RATIO:g} times sphere.radius = "
        f"{scene.sphere.radius!r}"
    )


@line("physics")
def vacancy_in_a_chain(scene: Derived) -> str:
    if scene.lattice != CHAIN:
        return ""
    for number, each in enumerate(scene.inclusion, 1):
        if each.vacancy:
            return f"inclusion {number}: vacancy = true: must be false in a chain, which it would break"
    share = scene.disorder.vacancies
    return f"disorder.vacancies = {share!r}: must be 0 in a chain, which they would break" if share else ""


@line("not built")
def gaps_too_wide(scene: Derived) -> str:
    spread = scene.disorder.radius
    if scene.lattice == CHAIN or spread <= LOOSEST:
        return ""
    return (
        f"disorder.radius = {spread!r}: must be at most {LOOSEST} in a sheet, whose neighbours have gaps of up to six "
        "times as many radii; good values are of the order of overlap / radius, "
        f"{scene.scale.length / scene.sphere.radius:.2g}"
    )


@line("physics")
def chain_with_sides(scene: Derived) -> str:
    packing = scene.packing
    if scene.lattice != CHAIN or packing.columns == 1 and packing.sides == FREE:
        return ""
    return (
        f'packing.columns = {packing.columns} and packing.sides = "{packing.sides}": must be 1 and "{FREE}" in a '
        f'chain, the default lattice without [wave]; for a sheet set packing.lattice = "{HEXAGONAL.name}"'
    )


@line("physics")
def restitution_of_pressed_spheres(scene: Derived) -> str:
    if not scene.packing.contact_force or scene.effects.restitution == 1:
        return ""
    return (
        f"effects.restitution = {scene.effects.restitution!r}: must be 1 beside packing.contact_force, as restitution "
        "belongs to collisions after which spheres separate"
    )


@line("physics")
def sphere_that_meets_nothing(scene: Derived) -> str:
    packing = scene.packing
    if scene.shape.spheres > 1 or WALL in (packing.first, packing.last):
        return ""
    return (
        f'packing.first = "{packing.first}": must be "wall", or packing.last must, with packing.rows = 1: a single '
        "sphere meets nothing else"
    )


@line("not built")
def periodic_chain(scene: Derived) -> str:
    if scene.lattice != CHAIN or not scene.shape.along_y:
        return ""
    return 'packing.ends = "periodic": must be "fixed" in a chain whose spheres just touch or are pressed together'


@line("physics", of=WITHOUT_WAVE)
def recorded_places(scene: Derived) -> str:
    output = scene.output
    if output.everyone:
        return ""
    troubles = place_troubles(output.rows, output.spheres, scene.shape, output.layers)
    return next((f"output: {trouble}" for trouble in troubles), "")


def _fastest(scene: Derived) -> str:
    """Return the key that declares the fastest initial velocity, and this velocity."""
    strikes = leads(scene.striker, scene.start, scene.sphere.radius)
    begins = "start.state" if scene.start.state else "start.noise"
    return f"{'striker' if strikes else begins}: velocity = {scene.scale.velocity:.6g}"


def _closing(scene: Derived) -> float:
    """Return the largest velocity with which spheres may meet, over that of the fastest; along y for two bodies."""
    if scene.shape.spheres > 2 or scene.start.noise:
        return 1.0
    along = [each.components[1] for each in scene.striker] + list(scene.start.motion[:, 4])
    bodies = [*along, 0.0] if len(along) < 2 else along
    closing = (max(bodies) - min(bodies)) / min(len(along), 2)
    return float(closing) / scene.scale.velocity


@line("physics")
def too_deep(scene: Derived) -> str:
    rest, length = max(scene.sphere.static_overlap, scene.material.unpressed_overlap), scene.scale.length
    meets = DEEPEST * length * _closing(scene) ** 0.8
    deepest = (rest + meets) / (2 * scene.sphere.radius)  # the force of both together is at most that of one
    if deepest <= LARGEST_OVERLAP_RATIO:
        return ""
    pressed = f"packing.contact_force = {scene.packing.contact_force!r}"
    if scene.start.touching:
        pressed = f"sphere.work_of_adhesion = {scene.material.work_of_adhesion!r}"
    return (
        f"{_fastest(scene) if rest < meets else pressed}: two spheres would overlap by {deepest:.3g} of the "
        f"diameter; at most {LARGEST_OVERLAP_RATIO} is allowed"
    )


@line("physics")
def lost_in_rounding(scene: Derived) -> str:
    shape, farthest = scene.shape, scene.start.farthest
    rounding = EPSILON / 2 * (max(shape.rows, shape.columns) * scene.sphere.radius + farthest)
    rate = sqrt(1.5 * sqrt(scene.sphere.static_overlap / scene.scale.length))  # frequency of spheres at rest, 1/t0
    motion = scene.scale.length / max(1.0, rate)  # ℓ, or v/ω for spheres that are pressed together
    if motion >= ROUNDINGS_IN_OVERLAP * rounding:
        return ""
    return (
        f"{_fastest(scene)}: its overlap of {motion:.3g} m is less than {ROUNDINGS_IN_OVERLAP:g} roundings of a "
        f"position in {shape.rows} rows x {shape.columns} columns, displaced by {farthest:.4g} m; must be faster, or "
        "the crystal and the displacement smaller"
    )
