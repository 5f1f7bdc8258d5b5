"""The blocks of ``in.NAME`` as they are written, and how their slots are filled.

``<slots>`` stand for the numbers of the scene and for the lines of its effects; a line whose slots stay empty is left
out.
"""

import re
from collections.abc import Mapping

from granular_lmp.errors import RunFolderError
from granular_lmp.lammps import sources
from granular_lmp.lammps.openings import begins_wider
from granular_lmp.lammps.outputs import LOG
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.schema import cut

_HEADING = """\
# <title>
# Runs as it is in this folder:  lmp -in in.<name>
# With other values:             lmp -in in.<name> -var amplitude 0.1 -var timestep 0.025
<invalid>"""

_VARIABLES = """\
# --- variables: these, and no others, may be overridden with -var NAME VALUE
variable amplitude index <amplitude>  # D0/Delta0
variable timestep  index <timestep>  # tau; rounded down to fit a whole number of steps into a sample
variable sample    index <sample>  # tau between records
variable duration  index <duration>  # tau
<ramp>
<friction>
variable data      index data.<name>
variable dump      index <dump>
<particles_variables>
variable checkpoint index <checkpoint_steps>  # steps between checkpoints, here for one core
variable marked    index unmarked  # a group without spheres, by which a checkpoint tells of which scene it is
if "<refused>" then "print 'ERROR: this deck is of one wave in one lattice: <names> is no variable of it'" "quit 1"
print "<said>"

# --- units <style>: <units>
variable Delta0 equal <Delta0>  # static overlap
variable R      equal <R>  # radius
variable t0     equal <t0>  # one tau
variable D0     equal v_amplitude*v_Delta0
variable every  equal ceil(v_sample/v_timestep-1e-9)
variable step   equal $(v_sample/v_every*v_t0:%.17g)
variable steps  equal v_every*floor(v_duration/v_sample+1e-9)
variable tau    equal step*v_step/v_t0"""

FIELD = "fix          wave all property/atom d_ux d_uy<angle_field> d_vx d_vy<spin_field><state_field>"

# The spheres and their wave, from the data file
READ = {
    "spheres": f"{FIELD}\nread_data    ${{data}} fix wave NULL wave",
    "wave_is": "the section wave of the data file holds",
}

_LATTICE = """\
# --- lattice at rest; <wave_is> the wave for unit amplitude
units        <style>
dimension    2
boundary     <along_x> <along_y> p
atom_style   <atom_style>
atom_modify  map array sort 1 0.0
comm_modify  vel yes
<spheres>
<mass>
group        mobile type <mobile>
neighbor     <skin> bin"""

_CONTACTS = """\
# --- contacts: normal law with E, damping, nu and half the work of adhesion; tangential law with friction
<contact>
<at_rest>"""

_PRELOAD = """\
# --- preload: LAMMPS starts every contact without shear, so the spheres are moved from rest to the wave in one
#     step without forces, which loads the shear springs; a long step, slow enough for negligible forces of dashpots
variable     slow  equal 1e6*v_step
timestep     $(v_slow:%.17g)
compute      u all displace/atom
variable     to_ux atom <to_ux>/v_slow
variable     to_uy atom <to_uy>/v_slow
velocity     all set v_to_ux v_to_uy NULL units box
<preload_spin>
fix          plane all enforce2d
fix          move mobile nve/noforce
thermo_style custom step
run          1 post no
unfix        move
reset_timestep 0
timestep     $(v_step:%.17g)"""

_WAVE = """\
# --- wave: the true velocities
variable     vx atom v_D0*d_vx/v_t0<state_vx>
variable     vy atom v_D0*d_vy/v_t0<state_vy>
velocity     all set v_vx v_vy NULL units box
<start_spin>
<start_angle>"""

_MEASURES = """\
compute      u all displace/atom
fix          plane all enforce2d
timestep     $(v_step:%.17g)"""

_MOTION = """\
# --- motion of the spheres that are not held
fix          move mobile <motion>
<quiet>"""

_GUARDS = """\
# --- guards: proof that the effects this deck leaves out do not occur
<guards>"""

_RECORD = """\
# --- record of the centre sphere, all digits; a checkpoint about every <checkpoint> minutes
group        ${marked} empty
restart      ${checkpoint} <checkpoints>
group        centre id <centre>
<read_angle>
dump         centre centre custom ${every} ${dump} id c_u[1] c_u[2]<angle_column> vx vy<spin_column>
dump_modify  centre format float %.17g colname c_u[1] ux colname c_u[2] uy<angle_name>
<particles_dump>"""

# Slots of quiet ends in which spheres turn
QUIET_TURN = {
    "quiet_turn": "fix          spin quiet store/state 1 omegaz\nvariable     kept_turn atom f_kept*f_spin\n",
    "quiet_spin": " omega 0.0 0.0 v_kept_turn",
}

RAMP = "variable ramp      index <switch_on>  # tau in which the first row is switched on"

# Columns of spheres, with the names that OVITO knows; ASE keeps v_theta
SPHERE_COLUMNS = "id type x y z radius<mass_column> c_u[1] c_u[2] vx vy vz<spin_column><angle_column>"
SPHERE_NAMES = "colname c_u[1] Displacement.X colname c_u[2] Displacement.Y"

# Slots of a scene with snapshots of all spheres
PARTICLES = {
    "particles_variables": "variable particles index <particles>  # tau between snapshots of all spheres\n"
    "variable snapshots index <snapshots>",
    "particles_dump": "variable     apart equal v_every*ceil(v_particles/v_sample-1e-9)\n"
    f"dump         particles all custom ${{apart}} ${{snapshots}} {SPHERE_COLUMNS}\n"
    f"dump_modify  particles sort id format float %.17g {SPHERE_NAMES}",
    "particles_append": "dump_modify  particles append yes",
}

# Names that somebody would try with -var, and that would be ignored
NO_VARIABLES = ("xi", "mode", "rows", "columns", "amp")
_SAID = "granular-lmp variables: "

# Contents of the slots that no effect of a scene fills
UNCALLED = dict.fromkeys(
    ("friction", "angle_field", "spin_field", "spin_column", "preload_spin", "start_spin", "mass", "start_angle")
    + ("read_angle", "angle_column", "angle_name", "quiet", "quiet_turn", "quiet_spin"),
    "",
) | {"motion": "nve", "atom_style": "sphere"}

_STARTED = (_PRELOAD, _WAVE)


def variables_line(scene: Scene, lines: Mapping[str, str]) -> str:
    """Return what a deck prints of its variables, so that the log of a run says what -var made of them."""
    optional = {
        "friction": bool(lines.get("friction")),
        "ramp": scene.wave.form == "driven",
        "particles": scene.output.particles > 0,
    }
    names = [
        "amplitude",
        "timestep",
        "sample",
        "duration",
        "dump",
        *(name for name, there in optional.items() if there),
    ]
    return _SAID + " ".join(f"{name}=${{{name}}}" for name in names)


def said_variables(log: str) -> dict[str, str] | None:
    """Return the variables of the run of a log, name → value; None if the log does not say them.

    Raises
    ------
    RunFolderError
        If it says a word that is not NAME=VALUE.
    """
    lines = [line for line in log.splitlines() if line.startswith(_SAID)]
    if not lines:
        return None
    said = {}
    for word in lines[-1].removeprefix(_SAID).split():
        name, equals, value = word.partition("=")
        if not (name and equals and value):
            raise RunFolderError(f"{LOG}: says {cut(word)!r} among its variables: must be NAME=VALUE")
        said[name] = value
    return said


def written(scene: Scene) -> tuple[str, ...]:
    """Return the blocks of the deck of a scene."""
    moves = scene.start.state or scene.wave.form in ("running", "standing")
    start = (*(_STARTED if moves else (_MEASURES,)), *(("<strikers>",) if scene.striker else ()), *_drives(scene))
    begin = ("<begin>",) if begins_wider(scene) else ()
    before = (_HEADING, _VARIABLES, _LATTICE, _CONTACTS, *begin, *start, _MOTION, _GUARDS, _RECORD)
    return (*before, *_monitors(scene), "run ${steps}")


def _drives(scene: Scene) -> tuple[str, ...]:
    """Return the blocks of what drives spheres from outside."""
    row = (sources.DRIVEN_ROW,) if scene.wave.form == "driven" else ()
    return (*row, *(("<sources>",) if scene.source else ()))


def _monitors(scene: Scene) -> tuple[str, ...]:
    return ("<monitors>",) if scene.monitor else ()


def resumed(scene: Scene) -> tuple[str, ...]:
    """Return the blocks of the input that continues a run from a checkpoint."""
    return (
        "# <title>: continues from <from>\nlog <log> append",
        _VARIABLES,
        "atom_modify  sort 1 0.0\ncomm_modify  vel yes\nread_restart <from>\nneighbor     <skin> bin",
        _CONTACTS,
        _MEASURES,
        *(("<field>",) if scene.wave.form == "driven" else ()),
        *_drives(scene),
        _MOTION,
        _GUARDS,
        _RECORD + "\ndump_modify  centre append yes\n<particles_append>",
        *_monitors(scene),
        "run ${steps} upto",
    )


def filled_text(blocks: tuple[str, ...], values: Mapping[str, str]) -> str:
    """Return blocks with their slots filled, an empty line between two."""
    return "\n\n".join(filled(block, values) for block in blocks) + "\n"


def filled(block: str, values: Mapping[str, str]) -> str:
    """Return a block with its ``<slots>`` replaced by lines, and the slots in these lines by numbers.

    A line that holds only empty slots is left out.
    """
    slot = re.compile(r"<(\w+)>")

    def fill(text: str) -> str:
        return slot.sub(lambda match: values[match[1]], text)

    filled_lines = [(line, fill(fill(line))) for line in block.split("\n")]
    return "\n".join(text for line, text in filled_lines if text.strip() or not line.strip())
