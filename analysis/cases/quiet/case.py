"""Reflection |r| of quiet ends over wave number and thickness, for each mode: theory as lines, runs as marks.

    granular-analysis quiet SWEEP... [-o FILE]

A line is |r| of the layer that is best for one wave alone (`granular_lmp.crystal.quiet_ends`). A run has a driven row;
its layer was chosen for the free wave at 2Ω too, and may reflect the wave itself more. A ring is theory for the layer
and the time step of a run, a dot is LAMMPS. Theory is the one with which the package chooses its layers.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.optimize import minimize_scalar

from cases.runner import script
from granular_analysis.plotting import page
from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.mode import FULL, Mode
from granular_lmp.crystal.modes import MODES, bloch_mode
from granular_lmp.crystal.quiet_ends import quiet_end, reflection
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.rest.absorption import quiet_end_of, waves_at_ends
from granular_lmp.rest.linear import mode_of, physics_of, unit_contacts
from granular_lmp.runs.record import Record, Scene

THICKNESSES = (5, 10, 20, 40)
WAVENUMBERS = tuple(np.linspace(0.2, 2.9, 28).tolist())
_TITLES = {"L": "longitudinal", "TR": "transverse-rotational", "RT": "rotational-transverse"}
_NEAR = 6  # rows left out next to the source and the layer, in which other waves decay
_LATE = 0.75  # share of a run that is left out, in which the front must run to the layer and back


def incident(scene: Scene) -> Mode:
    """Return the wave that the driven row of a scene sends out, with the time step of the scene."""
    return waves_at_ends(scene, scene.time.step)[0]


def expected(scene: Scene) -> float:
    """Return |r| of the quiet end of a driven scene for its wave, from the linear lattice with the step of the run.

    Raises
    ------
    ValueError
        Unless the scene has a driven row before a quiet end.
    """
    end = quiet_end_of(scene)
    if end is None or not scene.form.driven:
        raise ValueError(f'{scene.name}: must have wave.form = "driven" and absorb.rows')
    return reflection(unit_contacts(scene), scene.sphere, incident(scene), end, physics_of(scene), scene.time.step)


def measured(record: Record) -> float:
    """Return |r| of the quiet end of a driven run, by least squares.

    The motion of the rows in the last quarter of the run is fitted with cos and sin at Ω in time, and A e^{iξn} + B
    e^{−iξn} in space. |r| is the smaller of the two amplitudes over the larger, as the crests of RT run against its
    energy. ξ is fitted too, because it depends on the amplitude. Good values: a ramp of ten periods, and ramp and way
    to the layer and back within two thirds of the run.

    Raises
    ------
    ValueError
        If the run is too short for a fit.
    """
    scene, snapshots = record.scene, record.snapshots()
    tau = snapshots.tau
    late = tau > _LATE * scene.time.duration
    rows = np.arange(_NEAR, scene.shape.rows - 1 - int(scene.absorb.rows) - _NEAR)
    if late.sum() < 20 or len(rows) < 8:
        raise ValueError(f"{record.folder}: {late.sum()} late snapshots of {len(rows)} rows: must be at least 20 of 8")
    along = int(scene.require_wave().mode == "L")
    field = snapshots.stack("displacement")[late][:, :: scene.shape.columns, along][:, rows]
    phase = mode_of(scene).frequency * tau[late]
    (cosine, sine), *_ = np.linalg.lstsq(np.column_stack([np.cos(phase), np.sin(phase)]), field)
    wave = cosine + 1j * sine

    def fitted(wavenumber: float) -> tuple[np.ndarray, float]:
        both = np.exp(1j * wavenumber * rows[:, None] * [1, -1])
        amplitudes = np.linalg.lstsq(both, wave)[0]
        return np.abs(amplitudes), float(np.linalg.norm(both @ amplitudes - wave))

    near = incident(scene).wavenumber + np.array([-1, 1]) * 0.3 / len(rows)
    found = minimize_scalar(lambda xi: fitted(xi)[1], bounds=near, method="bounded", options={"xatol": 1e-9})
    amplitudes, _ = fitted(found.x)
    return float(amplitudes.min() / amplitudes.max())


def best(sphere: Sphere, name: str, rows: int, wavenumbers: Sequence[float]) -> list[float]:
    """Return |r| of the best layer of a given thickness for each wave of a mode along y by itself."""
    lattice = unit_lattice(sphere)
    modes = [bloch_mode(lattice, sphere, WaveVector.of(xi), name, FULL) for xi in wavenumbers]
    return [quiet_end(lattice, sphere, [mode], 0.5, rows).reflection for mode in modes]


def table(runs: Sequence[Record]) -> str:
    """Return a line for each run: mode, wave number, rows, |r| in theory and in LAMMPS; and the median difference."""
    if not runs:
        raise ValueError("no run is finished; there is nothing to draw")
    both = np.array([(expected(run.scene), measured(run)) for run in runs])
    lines = [f"{'mode':5}{'xi':>6}{'rows':>6}{'theory':>12}{'LAMMPS':>12}"]
    for run, (theory, lammps) in zip(runs, both.tolist(), strict=True):
        place = f"{run.scene.require_wave().mode:5}{run.scene.wavenumber:6.3f}{int(run.scene.absorb.rows):6}"
        lines.append(f"{place}{theory:12.4e}{lammps:12.4e}")
    seen = both[both[:, 0] > 1e-4]
    apart = float(np.median(np.abs(seen[:, 1] / seen[:, 0] - 1)))
    return "\n".join([*lines, f"median of |LAMMPS/theory - 1|, |r| above 1e-4: {apart:.1e}"])


def draw(runs: Sequence[Record], wavenumbers: Sequence[float] = WAVENUMBERS) -> Figure:
    """Return the figure of runs, and of theory for their spheres."""
    sphere = runs[0].scene.sphere
    drawing = page(3.4)
    panels = drawing.subplots(1, len(MODES), sharey=True)
    for panel, name in zip(panels, MODES, strict=True):
        for place, rows in enumerate(THICKNESSES):
            reflections = best(sphere, name, rows, wavenumbers)
            panel.plot(wavenumbers, reflections, color=f"C{place}", label=f"best layer, {rows} rows")
        for run in (each for each in runs if each.scene.require_wave().mode == name):
            rows, wavenumber = int(run.scene.absorb.rows), run.scene.wavenumber
            colour = f"C{THICKNESSES.index(rows)}" if rows in THICKNESSES else "black"
            panel.plot(wavenumber, expected(run.scene), "o", color=colour, markersize=7, fillstyle="none")
            panel.plot(wavenumber, measured(run), ".", color="black", markersize=4)
        panel.set(title=f"{_TITLES[name]}\n({name})", xlabel=r"$\xi$ (rad per row)", yscale="log", ylim=(1e-6, 1))
    panels[0].set_ylabel(r"reflection $|r|$")
    ring = Line2D(
        [],
        [],
        marker="o",
        markersize=7,
        fillstyle="none",
        label="theory, layer that ran",
        linestyle="none",
        color="black",
    )
    dot = Line2D([], [], marker=".", markersize=4, label="LAMMPS", linestyle="none", color="black")
    lines, _ = panels[0].get_legend_handles_labels()
    drawing.legend(handles=[*lines, ring, dot], loc="outside lower center", ncols=3)
    return drawing


main = script(
    __name__,
    list,
    table,
    draw,
    ("sweeps", "folders of sweeps over driven rows and quiet ends"),
    figure="quiet_ends.png",
)
