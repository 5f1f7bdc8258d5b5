"""Five lattices as cases of LAMMPS's ``unittest/granular``, from decks of this package: ``benchmarks/unittest``.

    python -m benchmarks.lattice_cases

writes each case: the commands of a deck up to the motion of its spheres, with the spheres of the data file as
``create_atoms`` and ``set``, and the places, velocities, torques and spins that the LAMMPS at hand has in the end.
Every sphere begins with a velocity of its own beside the wave. So no number is 0 but for rounding, and each can be
held to a relative error, as LAMMPS's drivers do.
"""

import re
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp import Scene
from granular_lmp.lammps.deck import Deck, deck_of
from granular_lmp.lammps.installation import lammps_module
from granular_lmp.problem import prepare

Floats = NDArray[np.float64]

FOLDER = Path(__file__).with_name("unittest")
SEGMENTS = (40,)  # steps, of 1/20 τ; one, as the forces of dashpots are other ones where a run begins
EPSILON = 1e-7  # forces are small differences of overlaps, 2.5e-4 of a radius, which places round by 1e-13
RECORDED = {"run_pos": "x", "run_vel": "v", "run_torque": "torque", "run_omega": "omega"}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "dem16-chain-dmt-2d-nano": (
        "l_chain",
        {"packing.rows": 8, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4},
    ),
    "dem16-square-damped-2d-nano": (
        "tr_square",
        {"packing.rows": 4, "wave.wavenumber": np.pi / 2, "effects.viscosity": 1e-8},
    ),
    "dem16-hexagonal-mindlinforce-2d-nano": (
        "tr_periodic",
        {"packing.rows": 4, "wave.wavenumber": np.pi / 2, "effects.shear_law": "incremental"},
    ),
    "dem16-fcc-jkr-3d-nano": (
        "fcc_transverse",
        {"packing.rows": 4, "wave.wavenumber": np.pi / 2, "sphere.adhesion_law": "jkr"},
    ),
    "dem16-layer-wall-3d-nano": ("monolayer_rocking", {"packing.rows": 8, "wave.wavenumber": np.pi / 4}),
}
COMMON = {
    "wave.phase": 0.3,
    "effects.tracking": False,
    "time.timestep": 0.05,
    "time.sample": 2.0,
    "time.duration": 2.0,
    "output.particles": 2.0,
    "monitor": [],
}
_GIVEN = ("amplitude", "timestep", "sample", "duration", "friction")  # variables of a deck that its motion needs
_OF_GUARDS = re.compile(r"^\w+ +(touching|at_rest|rests_\w+|at_[xyz]\w+) ")


def scene_of(name: str) -> Scene:
    """Return the scene of a case: a shipped one in a small cell, in which every sphere has a velocity of its own."""
    shipped, values = CASES[name]
    scene = Scene.load(shipped).with_values(COMMON | values)
    speed = 0.1 * scene.displacement_amplitude / scene.sphere.time_scale
    return scene.with_values({"start.noise": speed, "start.seed": 16})


def commands(deck: Deck) -> dict[str, list[str]]:
    """Return the commands of a deck by the keys of a case."""
    text = re.sub(r" *&\n *", " ", deck.input_text)
    text = text[: text.index("# --- guards")]
    lines = [line for line in (re.sub(r"\s*#.*", "", line).rstrip() for line in text.splitlines()) if line]
    lines = [line for line in lines if not line.startswith(("if ", "print ")) and not _OF_GUARDS.match(line)]
    given = [re.match(r"variable +(\w+) +index +(.*)", line) for line in lines]
    variables = [f"{found[1]} {found[2]}" for found in given if found and found[1] in _GIVEN]
    lines = [line for line, found in zip(lines, given, strict=True) if found is None]
    style = next(number for number, line in enumerate(lines) if line.startswith("pair_style"))
    coefficients = [line for line in lines if line.startswith("pair_coeff")]
    before = [each for line in lines[:style] for each in (_spheres(deck) if "read_data" in line else [line])]
    after = [line for line in lines[style + 1 :] if line not in coefficients]
    return {
        "variables": variables,
        "pre_commands": [" ".join(line.split()) for line in before],
        "pair_style": ["granular"],
        "pair_coeff": [" ".join(line.split()[1:]) for line in coefficients],
        "post_commands": [" ".join(line.split()) for line in after],
    }


def _spheres(deck: Deck) -> Iterator[str]:
    """Yield the commands that make the spheres of a data file, with their fields at the start."""
    data = deck.data
    yield f"region box block {' '.join(map(repr, data.box.ravel().tolist()))} units box"
    yield "create_box 2 box"
    for place in data.position.tolist():
        yield f"create_atoms 1 single {' '.join(map(repr, place))} units box"
    yield f"set group all diameter {float(data.diameter[0])!r} density {float(data.density[0])!r}"
    names = [re.findall(r"d_\w+", line) for line in deck.input_text.splitlines() if "property/atom d_" in line]
    for columns, section in zip(names, (data.wave, data.state), strict=False):
        for number, row in enumerate(section.tolist(), 1):
            pairs = zip(columns, row, strict=True)
            yield f"set atom {number} " + " ".join(f"{name} {value!r}" for name, value in pairs)


def ran(case: Mapping[str, list[str]], newton: str) -> dict[str, Floats]:
    """Return what the spheres of a case have after each segment, (segments, N, 3) by key."""
    found: dict[str, list[Floats]] = {key: [] for key in RECORDED}
    lammps = lammps_module().lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    try:
        lammps.command(f"newton {newton}")
        lines = [f"variable {line.replace(' ', ' index ', 1)}" for line in case["variables"]]
        lines += [*case["pre_commands"], f"pair_style {case['pair_style'][0]}"]
        lines += [*(f"pair_coeff {line}" for line in case["pair_coeff"]), *case["post_commands"], "run 0 post no"]
        for line in lines:
            lammps.command(line)
        for steps in SEGMENTS:
            lammps.command(f"run {steps} post no")
            count = lammps.get_natoms()
            order = np.argsort(lammps.numpy.extract_atom("id")[:count])
            for key, name in RECORDED.items():
                found[key].append(lammps.numpy.extract_atom(name)[:count][order].copy())
    finally:
        lammps.close()
    return {key: np.array(values) for key, values in found.items()}


def text_of(case: Mapping[str, list[str]], spheres: int, found: Mapping[str, Floats]) -> str:
    """Return the YAML of a case, in the order and the layout of LAMMPS's own."""

    def block(key: str, lines: list[str]) -> str:
        return f"{key}: |\n" + "".join(f"  {line}\n" for line in lines)

    walls = any("wall/gran" in line for line in case["post_commands"])
    made = datetime.strptime(str(lammps_module().__version__), "%Y%m%d").strftime("%-d %b %Y")
    parts = [f"---\nlammps_version: {made}\ntags: granular lattice\n", f"epsilon: {EPSILON:g}\nskip_tests:\n"]
    parts += [block("prerequisites", ["atom sphere", "pair granular", *["fix wall/gran"] * walls])]
    parts += [block(key, case[key]) for key in ("pre_commands", "post_commands")]
    parts += [f"input_file:\nnatoms: {spheres}\n", block("variables", case["variables"])]
    parts += [f"pair_style: {case['pair_style'][0]}\n", block("pair_coeff", case["pair_coeff"])]
    parts += [f"run_segments: |-\n  {' '.join(map(str, SEGMENTS))}\n"]
    for key, values in found.items():
        rows = [
            f"{segment:3} {number:3} " + " ".join(f"{part:23.16e}" for part in vector)
            for segment, spheres_of in enumerate(values)
            for number, vector in enumerate(spheres_of, 1)
        ]
        parts.append(f"{key}: |2\n" + "".join(f"  {row}\n" for row in rows))
    return "".join([*parts, "...\n"])


def read(path: Path) -> tuple[dict[str, list[str]], dict[str, Floats]]:
    """Return commands by key, and what was recorded, from the file of a case."""
    blocks = re.findall(r"^(\w+):(?: \|[-2]?\n((?:  .*\n)*)| ?(.*)\n)", path.read_text("utf-8"), re.MULTILINE)
    case = {key: lines.split("\n")[:-1] if lines else [line] for key, lines, line in blocks}
    case = {key: [line.removeprefix("  ") for line in lines] for key, lines in case.items()}
    found = {}
    for key in RECORDED:
        table = np.array([line.split() for line in case.pop(key)], dtype=float)
        found[key] = table[:, 2:].reshape(len(SEGMENTS), -1, 3)
    return case, found


def departure(one: Mapping[str, Floats], other: Mapping[str, Floats]) -> float:
    """Return the largest relative difference of any component, as LAMMPS's drivers take it: over the smaller one."""
    worst = 0.0
    for key, values in one.items():
        apart, least = np.abs(values - other[key]), np.minimum(np.abs(values), np.abs(other[key]))
        worst = max(worst, float(np.where(least > 0, apart / np.where(least > 0, least, 1.0), apart).max()))
    return worst


def main() -> None:
    """Write every case."""
    for name in CASES:
        deck = deck_of(prepare(scene_of(name)))
        case = commands(deck)
        (FOLDER / f"{name}.yaml").write_text(text_of(case, len(deck.packing), ran(case, "on")), "utf-8")


if __name__ == "__main__":
    main()
