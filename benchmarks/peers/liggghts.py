"""LIGGGHTS: Hertz spheres without adhesion, held at the same overlap by the box; its shear law is the secant one too.

It has no DMT adhesion. A lattice pressed together until every overlap is Δ0 has the same contact stiffnesses and obeys
the same equations up to the pre-stress, which turns with the contacts: a relative difference of order Δ0/2R = 2.5e-4.
Its contacts start without shear like LAMMPS's, so the deck does the same force-free step first. The cell is a slab in
three dimensions, because with ``dimension 2`` LIGGGHTS takes the spheres for discs.
"""

import shutil
import subprocess
from pathlib import Path

import numpy as np

from benchmarks.problem import Contestant, Solution, Start, base_scene, centre_signals
from granular_lmp.rest.scene import Scene

DECK = """\
units        si
atom_style   granular
atom_modify  map array
boundary     p f p
newton       off
communicate  single vel yes
hard_particles yes
read_data    data.peer
group        mobile type 1
neighbor     {skin!r} bin
fix          m1 all property/global youngsModulus peratomtype {modulus!r} {modulus!r}
fix          m2 all property/global poissonsRatio peratomtype {poisson!r} {poisson!r}
fix          m3 all property/global coefficientRestitution peratomtypepair 2 1 1 1 1
fix          m4 all property/global coefficientFriction peratomtypepair 2 {friction!r} {friction!r} {friction!r} {friction!r}
pair_style   gran model hertz tangential history
pair_coeff   * *
timestep     {step!r}
fix          move mobile nve/noforce
run          1
unfix        move
include      set.velocity
fix          move mobile nve/sphere
group        centre id {centre}
reset_timestep 0
dump         centre centre custom {every} dump.centre id x y
dump_modify  centre format "%d %.17g %.17g"
thermo       {steps}
run          {steps}
"""  # noqa: E501 (a command is a line)
FRICTION = 2.0  # twice what our deck allows, because the sliding force has no adhesion in it: no contact slides


def solve(folder: Path) -> Solution:
    """Run the deck on one rank."""
    scene = base_scene()
    start, sphere, time = Start.of(scene), scene.sphere, scene.time
    step = time.step * sphere.time_scale
    (folder / "data.peer").write_text(_data(start, scene, step), encoding="utf-8")
    (folder / "set.velocity").write_text(_velocities(start), encoding="utf-8")
    deck = DECK.format(
        skin=sphere.radius / 10,
        modulus=sphere.youngs_modulus,
        poisson=sphere.poisson_ratio,
        friction=FRICTION,
        step=step,
        every=time.steps_per_sample,
        steps=time.steps,
        centre=start.centre + 1,
    )
    (folder / "in.peer").write_text(deck, encoding="utf-8")
    with (folder / "in.peer").open(encoding="utf-8") as script:
        command = ["liggghts", "-screen", "none"]
        subprocess.run(command, cwd=folder, check=True, stdin=script, stdout=subprocess.DEVNULL)
    lines = [line.split() for line in (folder / "dump.centre").read_text(encoding="utf-8").splitlines()]
    position = np.array([line[1:] for line in lines[9::10]], dtype=float)
    p, q = centre_signals(scene, position - start.position[start.centre])
    return Solution(p, q, _loop(folder / "log.liggghts"), len(start.position), time.steps)


def _data(start: Start, scene: Scene, step: float) -> str:
    """The lattice at rest, with the velocities that carry it to the wave in one step."""
    sphere = scene.sphere
    width, height = start.size.tolist()
    atoms = "\n".join(
        f"{i} {2 if held else 1} {2 * sphere.radius!r} {sphere.density!r} {x!r} {y!r} 0"
        for i, (held, (x, y)) in enumerate(zip(start.held, start.position.tolist(), strict=True), start=1)
    )
    moves = (start.displacement / step).tolist()
    velocities = "\n".join(f"{i} {vx!r} {vy!r} 0 0 0 {omega!r}" for i, (vx, vy, omega) in enumerate(moves, start=1))
    return (
        f"peer\n\n{len(start.held)} atoms\n2 atom types\n\n0 {width!r} xlo xhi\n0 {height!r} ylo yhi\n"
        f"{-2 * sphere.radius!r} {2 * sphere.radius!r} zlo zhi\n\nAtoms\n\n{atoms}\n\nVelocities\n\n{velocities}\n"
    )


def _velocities(start: Start) -> str:
    return "".join(
        f"set atom {i} vx {vx!r} vy {vy!r} omegaz {omega!r}\n"
        for i, (vx, vy, omega) in enumerate(start.velocity.tolist(), start=1)
    )


def _loop(log: Path) -> float:
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    return float([line.split()[3] for line in lines if line.startswith("Loop time of")][-1])


def missing() -> str:
    """Why it cannot take part."""
    return "" if shutil.which("liggghts") else "no program liggghts (apt-get install liggghts)"


CONTESTANT = Contestant("liggghts", "LIGGGHTS, Hertz without adhesion, pressed to Δ0", solve, missing)
