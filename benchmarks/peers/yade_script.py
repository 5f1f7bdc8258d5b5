"""Runs inside YADE (``yade -n -x -j1 yade_script.py FOLDER``): reads start.npz, writes record.json."""

# ruff: noqa: F403, F405, B905 (names of YADE's interpreter)
import json
import sys
import time
from math import atan
from pathlib import Path

import numpy as np
from yade import *  # type: ignore[import-not-found]  # only YADE has it

FRICTION = 10.0  # nothing slides

folder = Path(sys.argv[1])
with np.load(folder / "start.npz") as loaded:
    start = {name: loaded[name] for name in loaded.files}
radius, step, centre = float(start["radius"]), float(start["step"]), int(start["centre"])

material = O.materials.append(
    FrictMat(
        young=float(start["young"]),
        poisson=float(start["poisson"]),
        density=float(start["density"]),
        frictionAngle=atan(FRICTION),
    )
)
width, height = start["size"].tolist()
O.periodic = True
O.cell.setBox(width, 2 * height, 10 * radius)  # periodic in all directions: air keeps the held rows apart
for x, y in start["position"].tolist():
    ball = Sphere(radius=radius)
    body = Body()
    body.shape, body.mat = ball, O.materials[material]
    mass = 4 / 3 * np.pi * radius**3 * float(start["density"])
    body.state.mass = mass
    body.state.inertia = (0.4 * mass * radius**2,) * 3
    body.state.pos = body.state.refPos = (x, y, 5 * radius)
    body.aspherical = False
    body.bound = Aabb()
    body.state.blockedDOFs = "xyzXYZ"  # for the preload: moves as it is told
    O.bodies.append(body)

O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb()], verletDist=0.05 * radius),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom()],
        [Ip2_FrictMat_FrictMat_MindlinPhys(gamma=float(start["gamma"]))],
        [Law2_ScGeom_MindlinPhys_Mindlin(includeAdhesion=True)],
    ),
    NewtonIntegrator(damping=0, gravity=(0, 0, 0)),
    PyRunner(command="observe()", iterPeriod=1, firstIterRun=10**9, label="observer"),
]
O.dt = step
states = [body.state for body in O.bodies]

# Contacts at rest; then the displaced lattice with the velocity that would have brought it there in this step, so that
# the contacts pick up the shear of the wave.
O.step()
displaced = [state.pos + Vector3(ux, uy, 0) for state, (ux, uy, _) in zip(states, start["displacement"].tolist())]
for state, position, (ux, uy, angle) in zip(states, displaced, start["displacement"].tolist()):
    state.pos, state.vel, state.angVel = position, Vector3(ux, uy, 0) / step, Vector3(0, 0, angle / step)
O.step()

# Leapfrog: velocities half a step on, from the forces at τ = 0; then the first move.
for index, (state, position, (vx, vy, omega)) in enumerate(zip(states, displaced, start["velocity"].tolist())):
    if start["held"][index]:
        state.pos, state.vel, state.angVel = position, Vector3.Zero, Vector3.Zero
        continue
    force, torque = O.forces.f(index), O.forces.t(index)
    state.vel = Vector3(vx, vy, 0) + force * (step / 2 / state.mass)
    state.angVel = Vector3(0, 0, omega + torque[2] * step / 2 / state.inertia[2])
    state.pos = position + state.vel * step
    state.blockedDOFs = "zXY"

rest = start["position"][centre]
record = [[displaced[centre][axis] - rest[axis] for axis in (0, 1)]]
every, samples = int(start["every"]), int(start["samples"])


def observe():
    """Called by YADE after every sample: where the centre sphere is."""
    record.append([states[centre].pos[axis] - rest[axis] for axis in (0, 1)])


began = time.perf_counter()
observer.firstIterRun, observer.iterPeriod = O.iter + every - 2, every
O.run(every * samples - 1, True)
loop = time.perf_counter() - began
(folder / "record.json").write_text(json.dumps({"displacement": record, "loop": loop}))
