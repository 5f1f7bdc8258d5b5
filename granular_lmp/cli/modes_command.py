"""Command ``modes``: branches of the crystal of a scene at its wave vector, through the zone, and their density."""

from collections.abc import Callable, Mapping
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granular_lmp.cli.arguments import Commands, Options, add, json_argument, scene_arguments, scene_of
from granular_lmp.cli.output import say, say_json
from granular_lmp.errors import OutputError, SceneError

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from granular_lmp.crystal.wavevector import WaveVector
    from granular_lmp.rest.scene import Scene

Table = list[dict[str, Any]]  # a row is column → value


def add_to(commands: Commands) -> None:
    """Add the command to the parser."""
    modes = add(commands, "modes", _modes, "frequencies and shapes of the Bloch modes at the scene's wave vector")
    scene_arguments(modes)
    json_argument(modes)
    modes.add_argument("--plot", metavar="FILE", help="draw the dispersion in its direction, as PNG, PDF or SVG")
    modes.add_argument("--csv", metavar="FILE", help="write the table into a file")
    where = modes.add_mutually_exclusive_group()
    where.add_argument(
        "--path",
        metavar="CORNERS",
        nargs="?",
        const="",
        help="all branches through the Brillouin zone, such as G-M-K-G (default: all corners)",
    )
    where.add_argument(
        "--dos",
        metavar="POINTS",
        nargs="?",
        const=30,
        type=int,
        help="density of states, from this number of wave vectors along each axis of the zone (default: %(const)s)",
    )


def _modes(options: Options) -> int:
    scene = scene_of(options)
    of_modes = _modes_of if options.path is None and options.dos is None else _branches_of
    figure = (of_modes if scene.holding.has_modes else _bands_of)(scene, options)
    if options.plot:
        from granular_lmp.plot.signals import save

        save(figure(), options.plot)
        if not options.json:
            say(options.plot)
    return 0


def _bands_of(scene: "Scene", options: Options) -> "Callable[[], Figure]":
    """Print the bands of frequencies of waves along a compressed chain, and the gaps between them."""
    from granular_lmp.cli.bands import as_json, as_text, ranges
    from granular_lmp.problem import prepare

    if options.path is not None or options.dos is not None:
        raise SceneError(
            f"modes --path and --dos: {scene.name} must have spheres that adhere, or a compressed sheet; spheres that "
            "meet have no modes"
        )
    problem = prepare(scene)
    t0 = problem.scene.scale.time
    found, count = ranges(problem.rest.cell), len(problem.rest.cell[0])
    sound = problem.rest.pressed["sound_m_s"]
    if options.json:
        say_json({"cell": count, "t0_s": t0, "sound_m_s": sound} | as_json(found, t0))
    else:
        many = f"{count} sphere{'s' * (count > 1)}"
        say(f"{problem.scene.name}: {many} to a cell; sound {sound:.6g} m/s; t0 = {t0:.6g} s")
        for line in as_text(found, t0):
            say(line)

    def figure() -> "Figure":
        from granular_lmp.plot.motion import bands_figure

        return bands_figure(problem)

    return figure


def _modes_of(scene: "Scene", options: Options) -> "Callable[[], Figure]":
    """Print the Bloch modes at the wave vector of the scene, at Γ without a wave, and the bands of a chain."""
    from granular_lmp.cli.bands import as_json, as_text, ranges
    from granular_lmp.rest.at_rest import chain_cell

    vector = _vector_of(scene)
    cell, t0 = chain_cell(scene), scene.sphere.time_scale
    bands, table = ranges(cell) if cell else [], _at_wavevector(scene)
    _write(table, options)
    if options.json:
        say_json(
            {"wavenumber": vector.wavenumber, "direction": vector.direction, "t0_s": t0}
            | ({"left_out": left_out} if (left_out := _left_out(scene)) else {})
            | (as_json(bands, t0) if bands else {})
            | {"modes": {row["mode"]: {key: row[key] for key in row if key != "mode"} for row in table}}
        )
    else:
        _say_modes(scene, table)
        if cell:
            say(f"longitudinal waves along the actual chain (rows in a cell: {len(cell[0])}):")
            for line in as_text(bands, t0):
                say(line)

    def figure() -> "Figure":
        from granular_lmp.plot.signals import dispersion_figure

        return dispersion_figure(scene)

    return figure


def _vector_of(scene: "Scene") -> "WaveVector":
    """Return the wave vector of the wave of a scene; Γ without a wave."""
    return scene.lattice.vector(0.0) if scene.wave is None else scene.vector


def _at_wavevector(scene: "Scene") -> Table:
    """Return a row for each mode at the scene's wave vector."""
    import numpy as np

    from granular_lmp.crystal.lattices import lattice_constant
    from granular_lmp.crystal.modes import modes_at
    from granular_lmp.crystal.zone import group_velocities
    from granular_lmp.rest.linear import physics_of, wave_contacts

    crystal, sphere, physics = wave_contacts(scene), scene.sphere, physics_of(scene)
    vector = _vector_of(scene)
    k = np.array(vector.components) / lattice_constant(sphere)
    if physics.space or not vector.wavenumber:
        found = _of_crystal(scene, vector, k)
    else:
        modes = modes_at(crystal, sphere, vector, physics)
        found = [(m.frequency, {"mode": m.name, "p": m.p, "q": m.q, "f": m.f}) for m in modes]
    velocities = group_velocities(crystal, sphere, k, physics) * sphere.radius / sphere.time_scale
    velocities = velocities[len(velocities) - len(found) :]  # the lowest modes are motions that no contact resists
    order = np.argsort(np.argsort([frequency for frequency, _ in found], kind="stable"), kind="stable")
    hertz = 1 / sphere.time_scale / (2 * pi)
    return [
        row
        | {"frequency": frequency, "frequency_Hz": frequency * hertz}
        # At Γ the velocity of sound is not a derivative: it depends on the direction
        | ({"group_velocity_m_s": velocities[place].tolist()} if vector.wavenumber else {})
        for (frequency, row), place in zip(found, order, strict=True)
    ]


def _of_crystal(scene: "Scene", vector: "WaveVector", k: "NDArray[np.float64]") -> list[tuple[float, dict[str, Any]]]:
    """Return frequency, number, names and shares of each mode, the lowest first.

    If a mirror separates sagittal from shear-horizontal modes, degenerate modes are separated in the same way.
    """
    from granular_lmp.crystal.bloch import bloch_modes
    from granular_lmp.crystal.modes import MODES, named_in_space
    from granular_lmp.crystal.zone import CHARACTERS, characters
    from granular_lmp.rest.linear import physics_of, wave_contacts

    crystal, sphere, physics = wave_contacts(scene), scene.sphere, physics_of(scene)
    named = dict(named_in_space(crystal, sphere, vector, physics)) if physics.space else {}
    plane = {name: named.pop(name)[0] for name in MODES if name in named}
    if named:
        # Degenerate modes are ordered by name, which rounding cannot change
        modes = sorted(((*mode, name) for name, mode in named.items()), key=lambda mode: round(mode[0], 9))
    else:
        modes = [(*each, "") for each in zip(*bloch_modes(crystal, sphere, k, physics), strict=True)]
    rows = []
    for number, (frequency, shape, name) in enumerate(modes, 1):
        half = ("L",) if name[:1] == "S" else ("TR", "RT")  # S modes stay in the plane of k and z
        share = characters(shape[None, None], k[None], crystal.mass)[0, 0]
        stays = share[2] + share[3] < 1e-9
        also = [each for each in half if stays and each in plane and abs(plane[each] - frequency) < 1e-9]
        shares = dict(zip(CHARACTERS, share.tolist(), strict=True))
        rows.append((float(frequency), {"mode": str(number), "name": " ".join([name, *also]).strip()} | shares))
    return rows


def _left_out(scene: "Scene") -> str:
    """Return words for imperfections that the crystal of the modes does not include."""
    from granular_lmp.rest.words import imperfections

    return imperfections(scene.disorder, () if scene.wave_lattice.densities else scene.inclusion, scene.packing.table)


def _say_modes(scene: "Scene", table: Table) -> None:
    """Print the modes at the scene's wave vector."""
    shapes = "shapes with p2 + q2 + f2 = 1"
    if scene.wave_lattice.cell_size > 1:
        shapes += ", roots of sums over the cell"
    by_share = "name" in table[0]
    if by_share:
        shapes = "shares of the kinetic energy"
    where = "xi = 0, as there is no [wave] (--path has all wave vectors)"
    if scene.wave is not None:
        where = f"xi = {scene.wavenumber!r} rad per row" + ("" if scene.along == "y" else f" along {scene.along}")
    say(f"{where}; t0 = {scene.sphere.time_scale:.6g} s; {shapes}")
    if left_out := _left_out(scene):
        start = "" if scene.wave is None else ", the crystal in which the wave starts"
        say(f"modes of the perfect lattice{start}; left out: {left_out}")
    columns = [key for key, value in table[0].items() if isinstance(value, float) and "frequency" not in key]
    width = 10 if by_share else 12
    head = "".join(f"{column:>{width}}" for column in columns)
    named = f"{'name':8}" if by_share else ""
    speeds = _speeds(scene, table)
    head = f"{'group v (m/s)':>15}" * bool(speeds) + head
    say(f"{'mode':5}{named}{'Omega (rad/t0)':>18}{'frequency (Hz)':>18}{head}")
    for row, speed in zip(table, speeds or [""] * len(table), strict=True):
        shape = "".join(f"{row[column] + 0.0:{width}.{width - 4}f}" for column in columns)
        name = f"{row['name']:8}" if named else ""
        say(f"{row['mode']:5}{name}{row['frequency']:18.12f}{row['frequency_Hz']:18.6g}{speed}{shape}")


def _speeds(scene: "Scene", table: Table) -> list[str]:
    """Return the group velocity of each mode along k, m/s, negative if it is against k; none at Γ."""
    if "group_velocity_m_s" not in table[0]:
        return []
    unit = _vector_of(scene).unit
    along = [sum(v * e for v, e in zip(row["group_velocity_m_s"], unit, strict=False)) for row in table]
    rounding = 1e-9 * max(map(abs, along))
    return [f"{speed if abs(speed) > rounding else 0.0:15.6g}" for speed in along]


def _branches_of(scene: "Scene", options: Options) -> "Callable[[], Figure]":
    """Print the branches along a path through the zone, or their density."""
    from granular_lmp.crystal.zone import CHARACTERS, along_path, density_of_states
    from granular_lmp.rest.linear import physics_of, wave_contacts

    crystal, sphere, physics = wave_contacts(scene), scene.sphere, physics_of(scene)
    hertz = 1 / sphere.time_scale / (2 * pi)
    if options.path is None:
        if options.dos < 2:
            raise SceneError(f"--dos {options.dos}: must be at least 2")
        middle, density = density_of_states(crystal, sphere, physics, scene.wave_lattice, options.dos)
        table: Table = [
            {"frequency": x, "frequency_Hz": x * hertz, "density_per_Hz": y / hertz}
            for x, y in zip(middle.tolist(), density.tolist(), strict=True)
        ]
        said: dict[str, Any] = {"points": options.dos}
    else:
        branches = along_path(crystal, sphere, physics, scene.lattice, options.path)
        said = {"corners": [{"way": way, "name": name} for way, name in branches.corners]}
        table = [
            {"way": float(branches.way[at]), "kx": k[0], "ky": k[1], "kz": k[2], "branch": branch + 1}
            | {"frequency": float(frequency), "frequency_Hz": float(frequency) * hertz}
            | dict(zip(CHARACTERS, branches.character[at, branch].tolist(), strict=True))
            for at, k in enumerate(branches.wavevector.tolist())
            for branch, frequency in enumerate(branches.frequency[at])
        ]
    _write(table, options)
    if options.json:
        say_json({"t0_s": sphere.time_scale, "R_m": sphere.radius} | said | {"table": table})
    elif options.path is None:
        _say_density(table)
    else:
        _say_corners(table, branches.corners)

    def figure() -> "Figure":
        from granular_lmp.plot.branches import density_figure, path_figure

        if options.path is None:
            return density_figure(middle, density, scene)
        return path_figure(branches, scene)

    return figure


def _say_corners(table: Table, corners: tuple[tuple[float, str], ...]) -> None:
    """Print the frequencies at the corners of a path."""
    ways = sorted({row["way"] for row in table})
    for way, name in corners:
        at = min(ways, key=lambda each: abs(each - way))
        rows = {row["branch"]: row["frequency_Hz"] for row in table if row["way"] == at}
        say(f"{name:2} (Hz) " + " ".join(f"{frequency:.6g}" for frequency in rows.values()))
    say("--json, --csv FILE and --plot FILE give all wave vectors")


def _say_density(table: Table) -> None:
    """Print the range of frequencies and the bin with most modes."""
    there = [row for row in table if row["density_per_Hz"] > 0]
    most = max(there, key=lambda row: float(row["density_per_Hz"]))
    say(f"modes from {there[0]['frequency_Hz']:.6g} to {there[-1]['frequency_Hz']:.6g} Hz")
    say(f"largest density at {most['frequency_Hz']:.6g} Hz: share of {most['density_per_Hz']:.6g} of the modes per Hz")
    say("--json, --csv FILE and --plot FILE give the whole density")


def _write(table: Table, options: Options) -> None:
    """Write a table as CSV, a list of numbers as several columns."""
    import csv

    if not options.csv:
        return
    rows = [_flat(row) for row in table]
    try:
        with Path(options.csv).open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, rows[0], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    except OSError as error:
        raise OutputError(f"{options.csv}: cannot be written: {error.strerror}") from error


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row whose lists are columns NAME_x, NAME_y."""
    lists = {key: value for key, value in row.items() if isinstance(value, list)}
    flat = {f"{key}_{axis}": each for key, value in lists.items() for axis, each in zip("xyz", value, strict=False)}
    return {key: value for key, value in row.items() if key not in lists} | flat
