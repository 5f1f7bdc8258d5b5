"""Error over cost of an impact: a sphere strikes a row of touching spheres, in LAMMPS and by three schemes of ours.

    granular-analysis impact [-o FILE]

Twenty equal spheres, contact constant A and mass m of 1, struck at v = 1: a solitary wave runs through the row, spheres
part behind it, and the last one flies off. Left: the largest error of a velocity after 12 collision times, over the
steps to a collision time; and the error of one collision, averaged over where in a step the contact begins. Right: the
former over processor time. The reference is DOP853 with rtol = 1e-13. The script also prints the energy error of a
million steps between walls.
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from time import process_time
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cases.runner import script
from cases.solitary.chain import compressed, energies, uniform
from cases.solitary.chain_motion import SIXTH, VERLET, Scheme, collision_time, integrate, march
from granular_analysis.plotting import letter

Floats = NDArray[np.float64]

COUNT, END = 20, 12  # spheres; collision times
T = collision_time(1.0, 1.0, 1.0)
ROW, REST, STRUCK = uniform(COUNT), np.zeros(COUNT), np.eye(COUNT)[0]
STEPS = (5, 10, 20, 40, 80, 160, 320)  # to a collision time
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
REPEATS = 3  # runs that are timed; the shortest counts
MANY = 1_000_000  # steps between walls
PHASES = 64  # places in a step where a contact may begin
RADIUS = 500.0  # LAMMPS's spheres, in units of their overlap: rounding of the positions is 1e-12
SCHEMES: dict[str, Scheme] = {"velocity Verlet": VERLET, "symplectic, order 6": SIXTH}
COLOURS = {
    "velocity Verlet": "#0072b2",
    "symplectic, order 6": "#d55e00",
    "LAMMPS": "#000000",
    "LAMMPS, pairs": "#cc79a7",
    "DOP853": "#009e73",
}


class Run(NamedTuple):
    """Steps to a collision time (0 for DOP853), velocities at the end, and processor time in seconds."""

    steps: int
    velocities: Floats
    seconds: float


def lammps(
    count: int, step: float, steps: int, every: int, watched: tuple[int, int], velocity: float = 1.0
) -> tuple[Floats, Floats, float]:
    """Return times (T,), velocities (T, k) of the spheres from watched[0] to watched[1], and the seconds of the loop.

    Plain `lmp` runs a row of touching spheres, A = m = 1, of which the first is thrown at the others.
    """
    modulus = 1.5 / (RADIUS / 2) ** 0.5  # A = (4/3) E* √(R/2) = 1 with E* = E/2, ν = 0
    atoms = "\n".join(f"create_atoms 1 single {2 * RADIUS * place!r} 0 0" for place in range(count))
    deck = f"""
        units lj
        atom_style sphere
        boundary f f f
        newton on
        region box block {-2 * RADIUS} {2 * RADIUS * (count + 1)} {-2 * RADIUS} {2 * RADIUS} {-2 * RADIUS} {2 * RADIUS}
        create_box 1 box
        {atoms}
        set type 1 diameter {2 * RADIUS!r}
        set type 1 mass 1.0
        neighbor 20.0 bin
        pair_style granular
        pair_coeff * * hertz/material {modulus!r} 0.0 0.0 tangential linear_nohistory 0.0 0.0 damping velocity
        comm_modify vel yes
        group struck id 1
        velocity struck set {velocity!r} 0 0
        fix move all nve/sphere
        timestep {step!r}
        group watched id {watched[0] + 1}:{watched[1]}
        dump watched watched custom {every} velocities id vx
        dump_modify watched sort id format float %.17g
        thermo {steps}
        run {steps}
    """
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "in.row").write_text(deck, encoding="utf-8")
        command = [str(Path(sys.executable).with_name("lmp")), "-in", "in.row", "-screen", "none", "-nocite"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        lines = Path(folder, "velocities").read_text(encoding="utf-8").splitlines()
        log = Path(folder, "log.lammps").read_text(encoding="utf-8")
    spheres = watched[1] - watched[0]
    frames = np.array(lines, dtype=object).reshape(-1, 9 + spheres)[:, 9:]
    velocities = np.array([[float(line.split()[1]) for line in frame] for frame in frames])
    seconds = float(log.partition("Loop time of")[2].split()[0])
    times: Floats = step * every * np.arange(len(velocities), dtype=float)
    return times, velocities, seconds


def impact() -> dict[str, list[Run]]:
    """Return the runs of the struck row by solver."""
    runs = {name: [stepped(steps, scheme) for steps in STEPS] for name, scheme in SCHEMES.items()}
    runs["LAMMPS"] = [in_lammps(steps) for steps in STEPS]
    # Verlet's error is of second order in the step, and that of a pair of higher order
    runs["LAMMPS, pairs"] = [
        Run(fine.steps, (4 * fine.velocities - coarse.velocities) / 3, coarse.seconds + fine.seconds)
        for coarse, fine in zip(runs["LAMMPS"], runs["LAMMPS"][1:], strict=False)
    ]
    runs["DOP853"] = [adaptive(rtol) for rtol in TOLERANCES]
    return runs


def stepped(steps: int, scheme: Scheme) -> Run:
    """Return the run of a symplectic scheme."""
    return timed(steps, lambda: march(ROW, REST, STRUCK, T / steps, END * steps, scheme)[1][-1])


def adaptive(rtol: float) -> Run:
    """Return the run of DOP853."""
    return timed(0, lambda: integrate(ROW, REST, STRUCK, [END * T], rtol)[1][-1])


def in_lammps(steps: int) -> Run:
    """Return the run of LAMMPS, with the time of its loop."""
    found = [lammps(COUNT, T / steps, END * steps, END * steps, (0, COUNT)) for _ in range(REPEATS)]
    return Run(steps, found[0][1][-1], min(seconds for *_, seconds in found))


def timed(steps: int, solve: Callable[[], Floats]) -> Run:
    """Return the run that `solve` makes, with the least processor time of some repetitions."""
    seconds = []
    for _ in range(REPEATS):
        begun = process_time()
        velocities = solve()
        seconds.append(process_time() - begun)
    return Run(steps, velocities, min(seconds))


def errors(runs: list[Run]) -> list[float]:
    """Return the largest error of a velocity of each run."""
    return [float(np.max(np.abs(run.velocities - reference()))) for run in runs]


@cache
def reference() -> Floats:
    """Return the exact velocities at the end, to 1e-9."""
    _, (velocities,) = integrate(ROW, REST, STRUCK, [END * T], 1e-13)
    return velocities


def collision_error(steps: int, scheme: Scheme) -> float:
    """Return the error of the velocity after a collision, root mean square over where in a step the contact begins."""
    step = T / steps
    u, v = np.zeros((PHASES, 2)), np.zeros((PHASES, 2))
    u[:, 0], v[:, 0] = -step * np.arange(PHASES) / PHASES, 1.0
    _, (found,) = march(uniform(2), u, v, step, steps + steps // 2, scheme)
    return float(np.sqrt(np.mean((found[:, 1] - 1) ** 2)))


def energy_errors(force: float, steps: int, per_collision: int, samples: int = 1000) -> Floats:
    """Return the relative energy error (samples,) of ten spheres between rigid walls by velocity Verlet.

    force : that compresses the row; with 1 its contacts do not open, with 0 they open at every impact.
    """
    stiffness = np.ones(11)
    stiffness[[0, -1]] = 2 * np.sqrt(2)  # a sphere on a rigid plane over two such spheres
    chain, v = compressed(np.ones(10), stiffness, force), np.eye(10)[0]
    us, vs = march(chain, 0 * v, v, T / per_collision, steps, VERLET, every=steps // samples)
    result: Floats = energies(chain, us, vs).sum(axis=1) / 0.5 - 1
    return result


def draw(runs: dict[str, list[Run]]) -> Figure:
    """Left: error over steps to a collision time. Right: error over processor time."""
    figure = Figure(figsize=(9.5, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for name, found in runs.items():
        marker = "x" if name == "LAMMPS" else "o"
        style = {"color": COLOURS[name], "marker": marker, "markersize": 5, "linewidth": 1.0}
        right.loglog([run.seconds for run in found], errors(found), label=name, **style)
        if name != "DOP853":
            left.loglog([run.steps for run in found], errors(found), **style)
    for name, scheme in SCHEMES.items():
        one = [collision_error(steps, scheme) for steps in STEPS]
        left.loglog(STEPS, one, ":", color=COLOURS[name], label=f"one collision, {name}")
    steps = np.array([20.0, 160.0])
    left.loglog(steps, 3 * (steps / 4) ** -2.5 * 1e-2, color="grey", linewidth=0.8)
    left.annotate("slope −5/2", (165, 2.2e-6), color="grey", fontsize="small")
    left.set(xlabel="steps to a collision time", ylabel="largest error of a velocity / $v$")
    right.set(xlabel="processor time, s")
    letter((left, right))
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small", frameon=False)
    return figure


def table(runs: dict[str, list[Run]]) -> str:
    """Return the runs, a line each, and the energy errors between walls."""
    lines = [f"{'':22}{'steps/T':>8}{'error':>10}{'seconds':>10}"]
    lines += [
        f"{name:22}{run.steps or '':>8}{error:10.1e}{run.seconds:10.4f}"
        for name, found in runs.items()
        for run, error in zip(found, errors(found), strict=True)
    ]
    for force, says in ((1.0, "compressed, contacts stay closed"), (0.0, "touching, contacts open")):
        between_walls = energy_errors(force, MANY, 50)
        first, last = between_walls[:100].mean(), between_walls[-100:].mean()
        lines.append(f"energy error in {MANY:.0e} steps of T/50, {says}: first {first:.1e}, last {last:.1e}")
    return "\n".join(lines)


main = script(__name__, impact, table, draw)
