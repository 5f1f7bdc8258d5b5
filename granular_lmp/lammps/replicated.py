"""Large perfect sheets: the data file holds one period of rows, and LAMMPS makes the other rows and the wave.

Of the seconds that LAMMPS takes before the first step of a million spheres, seven tenths are the parsing of text, which
only its first rank does. So the data file of a sheet of `LARGE` spheres or more holds the one or two rows after which
the lattice repeats. LAMMPS replicates them and computes, with c and n the column and the row from the centre sphere,

    x = (c + 1/4) a,    y = n h,    u = Re[U e^{iθ}],    v = Re[−iΩ U e^{iθ}],    θ = n k_y h + c k_x a + phase

for unit amplitude. The operations of x, y and θ are those of `granular_lmp.crystal.lattices` and
`granular_lmp.scene.initial_fields` in the same order, so spheres have the same positions to the last bit. The fields
differ by one unit in their thirteenth decimal where the two cosines round to either side of it: 1e-13 D0.

Spheres have the same numbers on any number of ranks, because replicas are numbered by their place and not by their
rank. Numbers of ``create_atoms`` are those of the ranks.
"""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import lattice_constant
from granular_lmp.lammps import start
from granular_lmp.lammps.datafile import DataFile
from granular_lmp.problem import Problem
from granular_lmp.scene.scene import Scene

# Spheres from which a sheet is replicated. LAMMPS parses 1e5 of them in 0.9 s; smaller decks are data that one can read
LARGE = 100_000


def suits(scene: Scene) -> bool:
    """Return whether LAMMPS makes the spheres of a scene: a large perfect sheet, at rest or with a plane wave."""
    if scene.wave is None or scene.space == 3:
        return False
    waved = scene.wave.form in ("running", "standing", "none") and not scene.envelope.finite
    moved = scene.wave.form != "none" and any(each.motion for each in scene.source)
    made = waved and scene.perfect and not scene.start.moves and not moved
    alike = scene.lattice.sheet and scene.shape.infinite and scene.lattice.column_period == 1
    return made and alike and scene.shape.spheres >= LARGE


def first_rows(problem: Problem) -> DataFile:
    """Return the data file of the rows after which the lattice repeats, without a wave."""
    scene, units = problem.scene, problem.units
    period, to_deck = scene.lattice.row_period, units.number(scene.sphere.radius, length=1)
    first = problem.crystal[: period * scene.shape.columns]
    position = first.positions * to_deck
    spacing = _row_spacing(scene) * to_deck
    box = _box(problem, to_deck)
    box[1] = position[0, 1] + np.array([-0.5, period - 0.5]) * spacing
    return DataFile(
        box=box,
        kind=np.ones(len(first), dtype=int),
        position=position,
        diameter=2 * first.arrays["radius"] * to_deck,
        density=np.full(len(first), units.number(scene.sphere.density, mass=1, length=-3)),
        wave=np.empty((len(first), 0)),
        style="hybrid sphere dipole" if scene.effects.tracking is True else "sphere",
    )


def lines(problem: Problem) -> list[str]:
    """Return the lines of the deck that make all spheres, hold those of the ends, and set the fields of the wave."""
    scene, period = problem.scene, problem.scene.lattice.row_period
    (left, right), (bottom, top), _ = _box(problem, problem.units.number(scene.sphere.radius, length=1)).tolist()
    count, columns, rows = scene.shape.spheres, scene.shape.columns, scene.shape.rows
    across = scene.lattice.column_distance(lattice_constant(scene.sphere))
    shift = f"+{scene.lattice.shift!r}*(abs(v_row)%2)" if scene.lattice.shift else ""
    lines = ["read_data    ${data}", f"replicate    1 {-(-rows // period)} 1"]
    if rows % period:
        lines += [
            f"group        beyond id > {count}",
            "delete_atoms group beyond compress no",
            "group        beyond delete",
        ]
    lines += [
        f"change_box   all x final {left!r} {right!r} y final {bottom!r} {top!r} units box",
        "# column and row from the centre sphere, and with all digits the place there",
        f"variable     row    atom floor((id-1)/{columns})-{scene.shape.centre_row}",
        f"variable     column atom (id-1)%{columns}-{columns // 2}{shift}",
        f"variable     at_x   atom (v_column+0.25)*{across!r}*v_R",
        f"variable     at_y   atom v_row*{_row_spacing(scene)!r}*v_R",
        "set          group all x v_at_x y v_at_y",
    ]
    if not scene.shape.along_y:
        lines += [
            f"group        held id 1:{columns} {count - columns + 1}:{count}",
            "set          group held type 2",
            "group        held delete",
        ]
    return [*lines, start.field(problem), *_wave(problem)]


def _wave(problem: Problem) -> list[str]:
    """Return the lines that set the fields of the spheres that are not held; fields that are zero stay so."""
    scene, mode = problem.scene, problem.mode
    if scene.wave.form == "none":
        return []
    fields = {"ux": (mode.ux, "cos"), "uy": (mode.uy, "cos"), "phi": (-mode.f, "sin")}
    if scene.wave.form == "running":
        rates = {"vx": (mode.ux, "sin"), "vy": (mode.uy, "sin"), "vphi": (mode.f, "cos")}
        fields |= {name: (mode.frequency * size, wave) for name, (size, wave) in rates.items()}
    fields = {name: (size, wave) for name, (size, wave) in fields.items() if size}
    along_x = f"+{mode.vector.per_column!r}*v_column" if mode.vector.per_column else ""
    return [
        f"variable     angle  atom {mode.vector.per_row!r}*v_row{along_x}+{scene.wave.phase!r}",
        *(  # 13 decimals, as data files have
            f"variable     wave_{name} atom round({size!r}*{wave}(v_angle)*1e13)/1e13"
            for name, (size, wave) in fields.items()
        ),
        "set          type 1 " + " ".join(f"d_{name} v_wave_{name}" for name in fields),
    ]


def _box(problem: Problem, to_deck: float) -> NDArray[np.float64]:
    """Return the low and high face of the crystal along x, y and z."""
    low = problem.crystal.get_celldisp().ravel() * to_deck
    return np.column_stack([low, low + problem.crystal.cell.lengths() * to_deck])


def _row_spacing(scene: Scene) -> float:
    """Return the distance of rows in radii."""
    return scene.lattice.row_distance(lattice_constant(scene.sphere))
