"""Refusals of values that only some kinds of scenes can have, of spheres and their laws, and of sizes."""

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS
from granular_lmp.crystal.lattices import PLANE_LATTICES
from granular_lmp.crystal.scale import LARGEST_OVERLAP_RATIO
from granular_lmp.rest.derived import Derived
from granular_lmp.rest.refusal import ALL, AT_REST, WITHOUT_WAVE, Refusal, joining
from granular_lmp.scene.schema import AUTO, shown
from granular_lmp.scene.sections import DISTANCE, RESCALED, SHEAR_LAWS
from granular_lmp.scene.without_wave import NOT_HELD, WAVE

FEWEST_ROWS = 4  # fewest rows of a crystal with a wave
MOST_SPHERES = 10_000_000
LINES: list[Refusal] = []
line = joining(LINES, of=ALL)


@line("not built", of=WITHOUT_WAVE)
def lattice_in_space(scene: Derived) -> str:
    if scene.packing.lattice in PLANE_LATTICES:
        return ""
    return (
        f'packing.lattice = "{scene.packing.lattice}": must be one of {", ".join(PLANE_LATTICES)} without [wave], '
        "where a crystal has one layer"
    )


@line("physics", of=WITHOUT_WAVE)
def packing_left_open(scene: Derived) -> str:
    for name in ("rows", "columns", "ends", "first", "last"):
        if getattr(scene.packing, name) == AUTO:
            return f'packing.{name} = "auto": must be declared without [wave], as only a wave determines it'
    return ""


@line("physics", of=(NOT_HELD,))
def effects_left_open(scene: Derived) -> str:
    for name in ("rotation", "friction"):
        if getattr(scene.effects, name) == AUTO:
            allowed = "true or false" if name == "rotation" else "a number from 0"
            return (
                f'effects.{name} = "auto": must be {allowed} where spheres meet and part, as nothing at rest decides it'
            )
    return ""


@line("physics", of=(WAVE,))
def too_few_rows(scene: Derived) -> str:
    rows = scene.packing.rows
    if rows == AUTO or int(rows) >= FEWEST_ROWS:
        return ""
    return f'packing.rows = {rows}: must be a whole number from {FEWEST_ROWS} to 10000000, or "auto"'


@line("physics", of=AT_REST)
def friction_of_0(scene: Derived) -> str:
    if scene.effects.friction != 0:
        return ""
    return 'effects.friction = 0.0: must be a number in (0, 10000], or "auto"; effects.shear = false has no shear force'


@line("not built", of=AT_REST)
def rescaled_shear(scene: Derived) -> str:
    if scene.effects.shear_law != RESCALED:
        return ""
    return f'effects.shear_law = "{RESCALED}": must be one of {", ".join(SHEAR_LAWS)} where spheres are held at rest'


@line("physics")
def adhesion_law(scene: Derived) -> str:
    """Check that spheres adhere if their law acts beyond an overlap of 0."""
    material, effects = scene.material, scene.effects
    law = ADHESION_LAWS[material.adhesion_law]
    if effects.parting == DISTANCE and not law.late:
        late = " or ".join(f'"{name}"' for name, each in ADHESION_LAWS.items() if each.late)
        return f'effects.parting = "{DISTANCE}": needs sphere.adhesion_law = {late}; other contacts end at overlap 0'
    if not law.beyond:
        return ""
    if material.work_of_adhesion == 0 or effects.adhesion is False:
        return (
            f'sphere.adhesion_law = "{material.adhesion_law}": needs sphere.work_of_adhesion above 0, J/m2, and '
            f"effects.adhesion not false; now {material.work_of_adhesion!r} and {shown(effects.adhesion)} make Hertz "
            "contacts"
        )
    for number, each in enumerate(scene.inclusion, 1):
        if each.work_of_adhesion == 0:
            return (
                f"inclusion {number}: work_of_adhesion = {each.work_of_adhesion!r}: must be above 0 with "
                f'sphere.adhesion_law = "{material.adhesion_law}", as all contacts of a crystal have one law'
            )
    return ""


@line("physics")
def two_models_of_damping(scene: Derived) -> str:
    effects = scene.effects
    if not effects.viscosity or effects.restitution == 1:
        return ""
    return (
        f"effects.viscosity = {effects.viscosity!r} and effects.restitution = {effects.restitution!r}: are two models "
        "of damping; give one of them"
    )


@line("physics", of=AT_REST)
def spheres_at_rest(scene: Derived) -> str:
    """Check that something holds the lattice together, and that the static overlap and D0 of the wave are small."""
    material, sphere, effects = scene.material, scene.sphere, scene.effects
    if sphere.holding_force == 0:
        return (
            "packing.contact_force = 0.0: must be above 0 where no adhesion holds the spheres together "
            f"(sphere.work_of_adhesion = {material.work_of_adhesion!r}, effects.adhesion = {effects.adhesion!r})"
        )
    if effects.adhesion is True and material.work_of_adhesion == 0:
        return "effects.adhesion = true: needs sphere.work_of_adhesion above 0, J/m2"
    if sphere.overlap_ratio > LARGEST_OVERLAP_RATIO:
        return (
            f"sphere: the static overlap is {sphere.overlap_ratio:.3g} of the diameter with this radius, "
            f"youngs_modulus, work_of_adhesion and contact_force; at most {LARGEST_OVERLAP_RATIO} is allowed"
        )
    largest = sphere.radius / sphere.static_overlap / 10
    if scene.wave is not None and scene.wave.amplitude > largest:
        return f"wave.amplitude = {scene.wave.amplitude!r}: must be at most {largest:.3g} (D0 = R/10)"
    return ""


@line("physics")
def too_many_spheres(scene: Derived) -> str:
    shape = scene.shape
    if shape.spheres <= MOST_SPHERES:
        return ""
    key, layers = (" x packing.layers", f" x {shape.layers}") if shape.layers > 1 else ("", "")
    return (
        f"packing.rows x packing.columns{key} = {shape.rows} x {shape.columns}{layers}: must be at most {MOST_SPHERES} "
        "spheres (LAMMPS takes 690 MB for each million)"
    )


@line("physics")
def no_sample_in_the_run(scene: Derived) -> str:
    time = scene.time
    if time.sample <= time.duration:
        return ""
    return f"time.sample = {time.sample!r}: must be at most time.duration = {time.duration!r}"
