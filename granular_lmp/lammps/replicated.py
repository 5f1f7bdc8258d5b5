"""Large perfect sheets: the data file holds one period of rows, and LAMMPS makes the other rows and the wave.

Before the first step of a million spheres, LAMMPS spends 70 % of the time parsing text, on its first rank only. So the
data file of a sheet of `LARGE` or more spheres holds only the one or two rows after which the lattice repeats. LAMMPS
replicates them and computes, with column c and row n counted from the centre sphere,

    x = (c + 1/4) a,    y = n h,    u = Re[U e^{iθ}],    v = Re[−iΩ U e^{iθ}],    θ = n k_y h + c k_x a + phase

for unit amplitude. The operations for x, y and θ have the same order as in `granular_lmp.crystal.lattices` and
`granular_lmp.rest.initial_fields`, so positions agree to the last bit. Fields may differ by 1e-13 D0, one unit in their
thirteenth decimal, if the two cosines round differently. Spheres have the same identifiers on any number of ranks,
because replicas are numbered by place; with ``create_atoms`` identifiers would depend on the ranks.
"""

import numpy as np

from granular_lmp.crystal.lattices import lattice_constant
from granular_lmp.crystal.mode import Physics
from granular_lmp.effects.freedoms import style
from granular_lmp.lammps import start
from granular_lmp.lammps.datafile import DataFile
from granular_lmp.lammps.ends import box_of
from granular_lmp.problem import Problem
from granular_lmp.rest.linear import BlochWave, physics_of

# Fewest spheres of a replicated sheet. LAMMPS parses 1e5 spheres in 0.9 s, and data of smaller decks stay readable
LARGE = 100_000


def suits(problem: Problem) -> bool:
    """Return whether LAMMPS makes the spheres: for a large perfect sheet, at rest or with a plane wave."""
    scene = problem.scene
    if problem.wave is None:
        return False
    waved = not scene.form.driven and not scene.envelope.finite
    moved = scene.form.waves and any(each.motion for each in scene.source)
    made = waved and scene.perfect and not scene.start.moves and not moved
    alike = scene.lattice.sheet and scene.shape.infinite and scene.lattice.cell_size == 1
    return made and alike and scene.shape.spheres >= LARGE


def first_rows(problem: Problem) -> DataFile:
    """Return the data file of the rows after which the lattice repeats, without a wave."""
    scene, units = problem.scene, problem.units
    period, to_deck = scene.lattice.row_period, units.number(scene.sphere.radius, length=1)
    first = problem.rest.atoms[: period * scene.shape.columns * scene.shape.layers]
    position = first.positions * to_deck
    spacing = _row_spacing(problem) * to_deck
    box = box_of(problem)
    box[1] = position[:, 1].min() + np.array([-0.5, period - 0.5]) * spacing
    return DataFile(
        box=box,
        kind=np.ones(len(first), dtype=int),
        position=position,
        diameter=2 * first.arrays["radius"] * to_deck,
        density=np.full(len(first), units.number(scene.sphere.density, mass=1, length=-3)),
        wave=np.empty((len(first), 0)),
        style=style(problem),
    )


def lines(problem: Problem) -> list[str]:
    """Return the lines of the deck that make all spheres, hold the ends, and set the fields of the wave."""
    scene, period = problem.scene, problem.scene.lattice.row_period
    (left, right), (bottom, top), _ = box_of(problem).tolist()
    count, rows = scene.shape.spheres, scene.shape.rows
    in_row = count // rows
    across = scene.lattice.column_distance(lattice_constant(scene.sphere))
    lines = ["read_data    ${data}", f"replicate    1 {-(-rows // period)} 1"]
    if rows % period:
        lines += [
            f"group        beyond id > {count}",
            "delete_atoms group beyond compress no",
            "group        beyond delete",
        ]
    lines += [
        f"change_box   all x final {left!r} {right!r} y final {bottom!r} {top!r} units box",
        "# column and row from the centre sphere, and the place with all digits",
        f"variable     row    atom floor((id-1)/{in_row})-{scene.shape.centre_row}",
        *_places(problem),
        f"variable     at_x   atom (v_column+0.25)*{across!r}*v_R",
        f"variable     at_y   atom v_row*{_row_spacing(problem)!r}*v_R",
        "set          group all x v_at_x y v_at_y",
    ]
    if not scene.shape.along_y:
        lines += [
            f"group        held id 1:{in_row} {count - in_row + 1}:{count}",
            "set          group held type 2",
            "group        held delete",
        ]
    return [*lines, start.field(problem), *_wave(problem)]


def _places(problem: Problem) -> list[str]:
    """Return the lines of the variable column, with the shift of the stacking, in a bulk crystal by row and layer."""
    scene = problem.scene
    lattice, columns, layers = scene.lattice, scene.shape.columns, scene.shape.layers
    if not lattice.solid:
        shift = f"+{lattice.shift!r}*(abs(v_row)%2)" if lattice.shift else ""
        return [f"variable     column atom (id-1)%{columns}-{columns // 2}{shift}"]
    many = lattice.row_period * scene.shape.rows  # because % keeps the sign of a row
    shifts = [
        f"+{part - int(part)!r}*((v_row+{many})%{lattice.row_period}=={row})*(v_layer%{lattice.layer_period}=={layer})"
        for row, each in enumerate(lattice.stacking)
        for layer, (part, _, _) in enumerate(each)
        if part != int(part)
    ]
    return [
        f"variable     layer  atom (id-1)%{layers}",
        f"variable     column atom floor((id-1)/{layers})%{columns}-{columns // 2}{''.join(shifts)}",
    ]


def _wave(problem: Problem) -> list[str]:
    """Return the lines that set the nonzero fields of the spheres that are not held."""
    scene, wave = problem.scene, problem.wave
    if wave is None or not wave.declared.known.fills:
        return []
    mode = wave.mode
    along_x = f"+{mode.vector.per_column!r}*v_column" if mode.vector.per_column else ""
    angle = f"variable     angle  atom {mode.vector.per_row!r}*v_row{along_x}+{wave.declared.phase!r}"
    fields = _in_space(wave, physics_of(scene)) if scene.space == 3 else _in_plane(wave)
    return [
        angle,
        *(  # 13 decimals, as data files have
            f"variable     wave_{name} atom round({formula}*1e13)/1e13" for name, formula in fields.items()
        ),
        "set          type 1 " + " ".join(f"d_{name} v_wave_{name}" for name in fields),
    ]


def _in_space(wave: BlochWave, physics: Physics) -> dict[str, str]:
    """Return the formulas of the nonzero fields of a mode with six freedoms, by name."""
    mode, form, fields = wave.mode, wave.declared.known, {}
    names = [f"{field}{axis}" for field in ("u", "phi") for axis in "xyz"]
    for freedom in physics.coordinates:
        amplitude, name = mode.shape()[0, freedom], names[freedom]
        rate = -1j * mode.frequency * amplitude
        fields[name] = form.displacement * amplitude
        fields[f"v{name.removeprefix('u')}"] = form.velocity * rate
    smallest = 1e-14  # below the last of 13 decimals of a field
    return {
        name: f"({part.real!r}*cos(v_angle)-({part.imag!r})*sin(v_angle))"
        for name, part in ((name, complex(each)) for name, each in fields.items())
        if abs(part) > smallest
    }


def _in_plane(wave: BlochWave) -> dict[str, str]:
    """Return the formulas of the nonzero fields of a mode in the plane, by name."""
    form, mode = wave.declared.known, wave.mode
    moves = {"ux": (mode.ux, "cos"), "uy": (mode.uy, "cos"), "phi": (-mode.f, "sin")}
    rates = {"vx": (mode.ux, "sin"), "vy": (mode.uy, "sin"), "vphi": (mode.f, "cos")}
    fields = {name: (form.displacement * size, cosine) for name, (size, cosine) in moves.items()}
    fields |= {name: (form.velocity * mode.frequency * size, cosine) for name, (size, cosine) in rates.items()}
    return {name: f"{size!r}*{cosine}(v_angle)" for name, (size, cosine) in fields.items() if size}


def _row_spacing(problem: Problem) -> float:
    """Return the distance between rows, in radii."""
    return problem.scene.lattice.row_distance(lattice_constant(problem.scene.sphere))
