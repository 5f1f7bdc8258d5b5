"""The deck that one writes first: 201 × 100 spheres, put where the wave wants them, all dumped in default format.

Three habits, each measured on its own in the remark: a hundred columns where three do; contacts that start without
shear, because LAMMPS knows no history of spheres that are put down displaced; positions in six digits.
"""

import subprocess
from pathlib import Path

import numpy as np

from benchmarks.problem import Contestant, Floats, Solution, Start, base_scene, centre_signals, errors
from granular_lmp.errors import GranularError
from granular_lmp.lammps.installation import lmp_command
from granular_lmp.lammps.outputs import read_log

COLUMNS = 100
NM_PER_M = NS_PER_S = 1e9

DECK = """\
units        nano
dimension    2
boundary     p f p
atom_style   sphere
read_data    data.naive
group        mobile type 1
neighbor     50 bin
comm_modify  vel yes
pair_style   granular
pair_coeff   * * dmt {modulus} 0.0 {poisson} {half_adhesion} tangential mindlin NULL 0.0 0.5 damping velocity
timestep     {step!r}
fix          move mobile nve/sphere
fix          plane all enforce2d
dump         all all custom {every} dump.all id type x y z vx vy vz omegaz
group        centre id {centre}
dump         centre centre custom {every} dump.digits id x y
dump_modify  centre format float %.17g
thermo       100
run          {steps}
"""


def solve(folder: Path) -> Solution:
    """Run the deck with ``lmp`` on one rank and read the centre sphere from the dump of all spheres."""
    base = base_scene()
    scene = base.with_values({"packing.columns": COLUMNS})
    start, sphere, time = Start.of(scene), scene.sphere, scene.time
    (folder / "data.naive").write_text(_data(start, sphere.radius, sphere.density), encoding="utf-8")
    deck = DECK.format(
        modulus=sphere.youngs_modulus * 1e-6,  # MPa
        poisson=sphere.poisson_ratio,
        half_adhesion=sphere.work_of_adhesion / 2 * 1e3,  # mJ/m²
        step=time.step * sphere.time_scale * NS_PER_S,
        every=time.steps_per_sample,
        steps=time.steps,
        centre=start.centre + 1,
    )
    (folder / "in.naive").write_text(deck, encoding="utf-8")
    command = [*lmp_command(1), "-in", "in.naive", "-screen", "none"]
    subprocess.run(command, cwd=folder, check=True, stdin=subprocess.DEVNULL)
    loop = read_log(folder / "log.lammps").loop
    rest = start.position[start.centre]
    p, q = centre_signals(base, _positions(folder / "dump.all", start.centre + 1, (2, 3)) - rest)
    digits = centre_signals(base, _positions(folder / "dump.digits", start.centre + 1, (1, 2)) - rest)
    remark = "with all digits dumped its errors are {:.2g}, {:.2g}: the missing preload".format(*errors(base, *digits))
    return Solution(p, q, loop, len(start.position), time.steps, remark)


def _data(start: Start, radius: float, density: float) -> str:
    position = (start.position + start.displacement[:, :2]) * NM_PER_M
    velocity = start.velocity * [1.0, 1.0, 1 / NS_PER_S]  # m/s is nm/ns
    kind = np.where(start.held, 2, 1)
    width, height = (start.size * NM_PER_M).tolist()
    diameter, density = 2 * radius * NM_PER_M, density * 1e-6  # ag/nm³
    atoms = "\n".join(
        f"{i} {kind} {diameter!r} {density!r} {x!r} {y!r} 0"
        for i, (kind, (x, y)) in enumerate(zip(kind.tolist(), position.tolist(), strict=True), start=1)
    )
    velocities = "\n".join(f"{i} {vx!r} {vy!r} 0 0 0 {om!r}" for i, (vx, vy, om) in enumerate(velocity.tolist(), 1))
    return (
        f"naive\n\n{len(kind)} atoms\n2 atom types\n\n0 {width!r} xlo xhi\n0 {height!r} ylo yhi\n-500 500 zlo zhi\n\n"
        f"Atoms # sphere\n\n{atoms}\n\nVelocities\n\n{velocities}\n"
    )


def _positions(path: Path, identity: int, columns: tuple[int, int]) -> Floats:
    """x, y of one sphere in every snapshot of a text dump, m."""
    head = f"{identity} "
    with path.open(encoding="utf-8") as stream:
        lines = [line.split() for line in stream if line.startswith(head)]
    wanted = max(columns) + 1
    found = [[float(words[column]) for column in columns] for words in lines if len(words) >= wanted]
    if not found:
        raise GranularError(f"{path}: sphere {identity} is not in it")
    return np.array(found) / NM_PER_M


CONTESTANT = Contestant("naive", f"naive deck, 201 × {COLUMNS}, default dump, no preload", solve)
