"""From a scene to the text of a LAMMPS deck: ``in.NAME`` and ``data.NAME``.

The deck is complete: it runs with plain ``lmp -in in.NAME`` in its folder. What a user would vary without a new lattice
is an index variable, to be overridden with ``-var``. Each block of the deck is a function here that returns its lines.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import ase
import numpy as np

from granular_lmp.datafile import DataFile
from granular_lmp.effects import FRICTION_PER_AMPLITUDE, Effect, effects
from granular_lmp.errors import RunFolderError
from granular_lmp.modes import Mode, mode_along_y
from granular_lmp.packing import centre, hexagonal
from granular_lmp.scene import Scene
from granular_lmp.units import Units, units_for
from granular_lmp.wave import plane_wave

DUMP = "dump.centre"
LOG = "log.lammps"
CHECKPOINTS = ("checkpoint.a", "checkpoint.b")  # written in turn, so that one is whole at any moment
CHECKPOINT_INTERVAL = 1e8  # particle-steps: half a minute on one core
GUARD_INTERVAL = 50  # steps; a guard costs 1.3 steps, so this is 2.6 % of the run


@dataclass(frozen=True)
class Deck:
    """A deck and what it was made from.

    Attributes
    ----------
    scene : Scene
    packing : ase.Atoms
    mode : Mode
        The Bloch mode that starts the wave.
    effects : list of Effect
    input_text : str
        Contents of ``in.NAME``.
    data : DataFile
        What ``data.NAME`` holds.
    """

    scene: Scene
    packing: ase.Atoms
    mode: Mode
    effects: list[Effect]
    input_text: str
    data: DataFile

    @property
    def input_name(self) -> str:
        """``in.NAME``"""
        return f"in.{self.scene.name}"

    @property
    def data_name(self) -> str:
        """``data.NAME``"""
        return f"data.{self.scene.name}"

    def files(self) -> dict[str, Iterable[str]]:
        """Name → text, in pieces, of the three files that make a deck folder."""
        title = f"{_title(self.scene)}; units {units_for(self.scene.sphere.radius).style}"
        return {
            "scene.toml": [self.scene.to_toml()],
            self.input_name: [self.input_text],
            self.data_name: self.data.pieces(title),
        }

    def write(self, folder: str | Path, *, force: bool = False) -> None:
        """Write the three files into `folder`, which is made, or with `force` may be there already.

        Raises
        ------
        RunFolderError
            When the folder is there (without `force`) or cannot be written.
        """
        folder = Path(folder)
        with writable(folder):
            folder.mkdir(parents=True, exist_ok=force)
            for name, pieces in self.files().items():
                with (folder / name).open("w", encoding="utf-8") as stream:
                    stream.writelines(pieces)


@contextmanager
def writable(folder: Path) -> Iterator[None]:
    """Turn what the system says against making or writing a folder into a RunFolderError of one line."""
    try:
        yield
    except FileExistsError as error:
        raise RunFolderError(f"{folder}: is there already; choose another folder or say --force") from error
    except OSError as error:
        raise RunFolderError(f"{folder}: cannot be written: {error.strerror or error}") from error


def build(scene: Scene) -> Deck:
    """The deck of a scene; nothing is written.

    The wave starts as a Bloch mode of the lattice that LAMMPS simulates, so that no other mode is excited at first
    order in the amplitude.
    """
    packing = hexagonal(scene.sphere, scene.packing)
    mode = mode_along_y(packing, scene.sphere, scene.wavenumber, scene.wave.mode)
    units = units_for(scene.sphere.radius)
    return Deck(
        scene=scene,
        packing=packing,
        mode=mode,
        effects=effects(scene, packing, mode),
        input_text=_input_text(scene, units, centre(packing) + 1),
        data=_data(scene, packing, mode, units),
    )


def _title(scene: Scene) -> str:
    wave, packing = scene.wave, scene.packing
    return (
        f"{scene.name}: {wave.mode} wave along y, xi = {scene.wavenumber!r} rad per row, "
        f"D0 = {wave.amplitude!r} Delta0, {packing.rows} rows x {packing.columns} columns, {packing.ends} ends"
    )


def _data(scene: Scene, packing: ase.Atoms, mode: Mode, units: Units) -> DataFile:
    to_deck = units.number(scene.sphere.radius, length=1)
    low = packing.get_celldisp().ravel() * to_deck
    size = packing.cell.lengths() * to_deck
    fields = plane_wave(packing, mode, scene.wave.phase)
    return DataFile(
        box=np.column_stack([low, low + size]),
        kind=np.where(packing.arrays["fixed"], 2, 1),
        position=packing.positions * to_deck,
        diameter=2 * packing.arrays["radius"] * to_deck,
        density=np.full(len(packing), units.number(scene.sphere.density, mass=1, length=-3)),
        # 13 decimals of D0: finer than a double resolves a position of the lattice, coarser than what one machine's
        # cosine differs from another's, so that a scene gives the same bytes everywhere
        wave=np.hstack([fields.displacement, fields.velocity]).round(13) + 0.0,  # + 0.0: no minus zeros
    )


# --- the blocks of in.NAME -------------------------------------------------------------------------------------------


def _input_text(scene: Scene, units: Units, centre_id: int) -> str:
    blocks = [
        _heading(scene),
        _variables(scene, units),
        _lattice(scene, units),
        _contacts(scene, units),
        _preload(),
        _wave(),
        _motion(),
        _guards(scene),
        _record(scene, centre_id),
        "run ${steps}",
    ]
    return "\n\n".join(blocks) + "\n"


def resume_text(deck: Deck, checkpoint: str) -> str:
    """The input that continues a run of `deck` from a checkpoint, to the same bytes as if it had not been stopped.

    LAMMPS keeps neither pair coefficients nor ``comm_modify`` in a restart file, and finds the reference positions of
    ``compute displace/atom`` by its name: both are given again. https://docs.lammps.org/Howto_restart.html
    """
    scene, units = deck.scene, units_for(deck.scene.sphere.radius)
    blocks = [
        f"# {_title(scene)}: continues from {checkpoint}\nlog {LOG} append",
        _variables(scene, units),
        f"comm_modify  vel yes\nread_restart {checkpoint}\n{_neighbours(scene, units)}",
        _contacts(scene, units),
        "timestep     $(v_step:%.17g)\ncompute      u all displace/atom\nfix          plane all enforce2d",
        _motion(),
        _guards(scene),
        _record(scene, centre(deck.packing) + 1) + "\ndump_modify  centre append yes",
        "run ${steps} upto",
    ]
    return "\n\n".join(blocks) + "\n"


def _heading(scene: Scene) -> str:
    return f"""\
# {_title(scene)}
# Runs as it is in this folder:  lmp -in in.{scene.name}
# With other values:             lmp -in in.{scene.name} -var amplitude 0.1 -var timestep 0.025"""


def _variables(scene: Scene, units: Units) -> str:
    sphere, time = scene.sphere, scene.time
    return f"""\
# --- may be overridden with -var NAME VALUE
variable amplitude index {scene.wave.amplitude!r}  # D0/Delta0
variable timestep  index {time.timestep!r}  # tau; rounded down to fit a whole number of steps into a sample
variable sample    index {time.sample!r}  # tau between records
variable duration  index {time.duration!r}  # tau
variable friction  index $({FRICTION_PER_AMPLITUDE!r}*v_amplitude:%.17g)  # no sliding; much more would freeze the shear
variable data      index data.{scene.name}
variable dump      index {DUMP}

# --- units {units.style}: {units.names}
variable Delta0 equal {units.number(sphere.static_overlap, length=1)!r}  # static overlap of the adhesive contact
variable R      equal {units.number(sphere.radius, length=1)!r}  # radius
variable t0     equal {units.number(sphere.time_scale, time=1)!r}  # one tau
variable F      equal {units.number(sphere.pull_off_force, mass=1, length=1, time=-2)!r}  # adhesive force
variable D0     equal v_amplitude*v_Delta0
variable every  equal ceil(v_sample/v_timestep-1e-9)
variable step   equal v_sample/v_every*v_t0
variable steps  equal v_every*floor(v_duration/v_sample+1e-9)"""


def _lattice(scene: Scene, units: Units) -> str:
    along_y = "p" if scene.packing.ends == "periodic" else "f"
    return f"""\
# --- lattice at rest; the section wave of the data file holds the wave for unit amplitude
units        {units.style}
dimension    2
boundary     p {along_y} p
atom_style   hybrid sphere dipole
atom_modify  map array
comm_modify  vel yes
fix          wave all property/atom d_ux d_uy d_phi d_vx d_vy d_vphi
read_data    ${{data}} fix wave NULL wave
mass         * 1.0  # asked for by the dipole style, not used: spheres have their own
group        mobile type 1
{_neighbours(scene, units)}"""


def _neighbours(scene: Scene, units: Units) -> str:
    return f"neighbor     {units.number(scene.sphere.radius / 10, length=1)!r} bin"


def _contacts(scene: Scene, units: Units) -> str:
    sphere = scene.sphere
    modulus = units.number(sphere.youngs_modulus, mass=1, length=-1, time=-2)
    half_adhesion = units.number(sphere.work_of_adhesion / 2, mass=1, time=-2)
    return f"""\
# --- contacts: DMT with E, no damping, nu, gamma = w/2; Mindlin shear (secant law) with friction
pair_style   granular
pair_coeff   * * dmt {modulus!r} 0.0 {sphere.poisson_ratio!r} {half_adhesion!r} &
             tangential mindlin NULL 0.0 ${{friction}} damping velocity"""


def _preload() -> str:
    return """\
# --- preload: LAMMPS starts every contact without shear, so the spheres are moved from rest to the wave in one
#     step without forces, which loads the shear springs
timestep     $(v_step:%.17g)
compute      u all displace/atom
variable     to_ux atom v_D0*d_ux/v_step
variable     to_uy atom v_D0*d_uy/v_step
variable     to_th atom v_D0*d_phi/v_R/v_step
variable     zero  atom 0.0
velocity     all set v_to_ux v_to_uy NULL units box
set          group all omega v_zero v_zero v_to_th
fix          plane all enforce2d
fix          move mobile nve/noforce
thermo_style custom step
run          1 post no
unfix        move
reset_timestep 0"""


def _wave() -> str:
    return """\
# --- the wave: true velocities, and the dipole turned to the angle of the sphere
variable     vx atom v_D0*d_vx/v_t0
variable     vy atom v_D0*d_vy/v_t0
variable     om atom v_D0*d_vphi/v_R/v_t0
variable     mx atom cos(v_D0*d_phi/v_R)
variable     my atom sin(v_D0*d_phi/v_R)
velocity     all set v_vx v_vy NULL units box
set          group all omega v_zero v_zero v_om
set          group all dipole v_mx v_my v_zero"""


def _motion() -> str:
    return """\
# --- motion: translation, rotation, and the dipole that turns with the sphere
fix          move mobile nve/sphere update dipole"""


def _guards(scene: Scene) -> str:
    return f"""\
# --- guards: smallest overlap in Delta0 of the contacts that touch, how many have opened since the start, largest
#     shear force over the sliding force (never less than the truth)
compute      contact all pair/local dist p4
compute      largest all reduce max c_contact[1] c_contact[2] inputs local
compute      total   all reduce sum c_contact[1] inputs local
compute      mean    all reduce ave c_contact[1] inputs local
variable     tau     equal step*v_step/v_t0
variable     overlap equal (2*v_R-c_largest[1])/v_Delta0
variable     open    equal {_contact_count(scene)}-round(c_total/c_mean)
variable     slip    equal c_largest[2]/(v_friction*v_F*(1+v_overlap^1.5))
thermo_style custom step v_tau v_overlap v_open v_slip
thermo       {GUARD_INTERVAL}"""


def _contact_count(scene: Scene) -> int:
    """Contacts at rest: three a sphere, less the two a column that held ends leave out."""
    packing = scene.packing
    return 3 * packing.rows * packing.columns - (0 if packing.ends == "periodic" else 2 * packing.columns)


def _record(scene: Scene, centre_id: int) -> str:
    particles = scene.packing.rows * scene.packing.columns
    return f"""\
# --- record of the centre sphere, all digits; a checkpoint every {CHECKPOINT_INTERVAL:.0e} particle-steps
restart      {ceil(CHECKPOINT_INTERVAL / particles)} {" ".join(CHECKPOINTS)}
group        centre id {centre_id}
compute      dipole centre property/atom mux muy
variable     theta atom atan2(c_dipole[2],c_dipole[1])
dump         centre centre custom ${{every}} ${{dump}} id c_u[1] c_u[2] v_theta vx vy omegaz
dump_modify  centre format float %.17g colname c_u[1] ux colname c_u[2] uy colname v_theta theta"""
