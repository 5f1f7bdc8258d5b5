"""Checks of the files that a deck writes and reads, and of the settings that LAMMPS needs for them."""

import re
from collections.abc import Iterator, Sequence
from math import floor, log10

import numpy as np

from granular_lmp.foreign.between import MOVING, changes
from granular_lmp.foreign.finding import Check, Finding
from granular_lmp.foreign.interpreter import Command
from granular_lmp.foreign.reading import Reading
from granular_lmp.foreign.stages import DUMPS
from granular_lmp.foreign.vibrations import contacts_of, expected_displacement

Words = tuple[str, ...]

_DIGITS = 3  # a dump should resolve displacements of the size of an overlap with this many digits
_POSITIONS = ("x", "y", "z", "xs", "ys", "zs", "xu", "yu", "zu", "xsu", "ysu", "zsu")
_SINGLE = {"dcd": 7, "xtc": 6, "xyz": 6, "atom": 6}  # digits of the styles of dumps without columns
_ON_FACE = 1e-9  # distance from a periodic face, in radii


def _coarse_dumps(reading: Reading) -> Iterator[Finding]:
    expected = expected_displacement(reading)
    writing = {id(dump) for stage in reading.stages for dump in stage.dumps}
    settings = [*dict.fromkeys(command.words for command in reading.named("dump_modify"))]  # a loop repeats its lines
    for dump in [] if expected is None else reading.dumps:
        assert expected is not None
        unit = _unit(reading, dump, settings) if id(dump) in writing else 0.0
        if unit and (left := log10(expected / unit)) < _DIGITS:
            yield Finding(
                dump,
                f"positions are written to {unit:.1g}; of displacements as large as the overlap (or the depth of a "
                f"collision), {expected:.3g}, this leaves {max(0, floor(left))} digits",
                min(1.0, unit / expected),
                f"dump_modify {dump.words[1]} format float %.17g",
            )


def _unit(reading: Reading, dump: Command, settings: Sequence[Words]) -> float:
    """Return the unit of the last digit of positions in a dump, in units of the deck; 0 if it holds displacements."""
    spheres = reading.spheres
    assert spheres is not None
    largest = np.abs(spheres.position).max(axis=0)[: reading.dimension]
    style, columns = dump.words[3].split("/")[0], dump.words[6:]
    if style in _SINGLE:
        return _last_digit(float(largest.max()), _SINGLE[style])
    displacements = any(name.startswith(("c_", "v_", "f_")) for name in columns)
    if dump.words[3] not in ("custom", "custom/gz", "custom/zstd") or displacements or dump.words[5].endswith(".bin"):
        return 0.0
    axes = {name: "xyz".index(name[0]) for name in columns if name in _POSITIONS}
    formats = _formats(dump.words[1], columns, settings)
    units = [_rounding(formats[name], float(largest[axis])) for name, axis in axes.items() if axis < len(largest)]
    return max(units, default=0.0)


def _formats(name: str, columns: Words, settings: Sequence[Words]) -> dict[str, str]:
    """Return the formats of the columns of a dump."""
    formats = dict.fromkeys(columns, "%g")
    for words in settings:
        if words[1:2] != (name,):
            continue
        for keyword, kind, text in zip(words, words[1:], words[2:], strict=False):
            if keyword == "format" and kind == "float":
                formats = dict.fromkeys(columns, text)
            elif keyword == "format" and kind == "line":
                formats |= dict(zip(columns, text.split(), strict=False))
            elif keyword == "format" and kind.isdecimal() and int(kind) <= len(columns):
                formats[columns[int(kind) - 1]] = text
    return formats


def _rounding(text: str, largest: float) -> float:
    """Return the last digit of numbers up to a largest one in a format of C; 0 if the format is not known."""
    match = re.search(r"%[-+ #0]*\d*(?:\.(\d+))?l?([efg])", text)
    if match is None:
        return 0.0
    digits = int(match[1] or 6)
    return 10.0**-digits if match[2] == "f" else _last_digit(largest, digits + (match[2] == "e"))


def _last_digit(largest: float, digits: int) -> float:
    return 10.0 ** (floor(log10(largest)) + 1 - digits) if largest else 0.0


def _moved_frames(reading: Reading) -> Iterator[Finding]:
    told: set[int] = set()
    places = {id(dump): n for n, dump in enumerate(reading.commands)} if reading.named(*MOVING) else {}
    for dump in dict.fromkeys(reading.dumps) if places else ():  # a loop repeats its lines
        for command in changes(reading, [dump], places[id(dump)]) if dump.words[3] in DUMPS else ():
            if command.name in MOVING and id(command) not in told:
                told.add(id(command))
                yield Finding(
                    command,
                    f"'{command}' moves spheres in no time, and the dump {dump.words[1]} of {dump.place} is on: it has "
                    "frames from before and after, which belong to no motion",
                    None,
                    f"undump {dump.words[1]}, before this line; or dump ... behind it",
                )


def _velocities_of_ghosts(reading: Reading) -> Iterator[Finding]:
    styles = [command for command in reading.named("pair_style") if command.words[1].startswith("gran")]
    given = [command for command in reading.named("comm_modify") if "vel" in command.words]
    if styles and not (given and given[-1].words[given[-1].words.index("vel") + 1] == "yes"):
        yield Finding(
            given[-1] if given else styles[-1],
            "there is no comm_modify vel yes",
            None,
            "comm_modify vel yes, before pair_style",
        )


def _forgotten_slip(reading: Reading) -> Iterator[Finding]:
    contacts = contacts_of(reading)
    if contacts is None or not contacts.shear.any():
        return
    for command, step in reading.data_steps.items():
        yield Finding(
            command,
            f"the file holds step {step} of a run, and {int((contacts.shear > 0).sum())} contacts start without slip",
            None,
            "write_restart and read_restart, with pair_style and pair_coeff repeated",
        )


def _restart_without_law(reading: Reading) -> Iterator[Finding]:
    restarts = reading.named("read_restart")
    if restarts and not [command for command in reading.named("pair_style") if command.words[1] != "none"]:
        yield Finding(
            restarts[-1],
            "no pair_style and pair_coeff follow",
            None,
            "pair_style and pair_coeff, as in the first run, behind this line",
        )


def _on_faces(reading: Reading) -> Iterator[Finding]:
    spheres, writing = reading.spheres, reading.named("restart", "write_restart")
    if spheres is None or not writing:
        return
    for axis, periodic in enumerate(reading.periodic[: reading.dimension]):
        place = spheres.position[:, axis]
        low, high = (np.abs(place - face[axis]) < _ON_FACE * spheres.radius for face in (reading.low, reading.high))
        if periodic and (low | high).any():
            yield Finding(
                writing[-1],
                f"{int((low | high).sum())} spheres lie on the periodic face {'xyz'[axis]}",
                None,
                f"shift the lattice along {'xyz'[axis]} by a quarter of its constant",
            )


def _ignored_loss(reading: Reading) -> Iterator[Finding]:
    for command in reading.named("thermo_modify"):
        if dict(zip(command.words[1:], command.words[2:], strict=False)).get("lost") in ("ignore", "warn"):
            yield Finding(command, f"'{command}'", None, "thermo_modify lost error")


CHECKS = (
    Check(
        "coarse-dump",
        "A wave moves spheres by less than their overlap, and %g keeps six digits of the position.",
        _coarse_dumps,
    ),
    Check(
        "frames-without-motion",
        "Velocities, spectra and fronts of a dump are wrong if no time passes between two of its frames.",
        _moved_frames,
    ),
    Check(
        "ghost-velocities",
        "Dashpots and slip need the velocities of spheres beyond periodic faces and on other processors.",
        _velocities_of_ghosts,
    ),
    Check(
        "forgotten-slip",
        "A data file holds no history of contacts, so that shear forces drop to 0.",
        _forgotten_slip,
    ),
    Check(
        "restart-without-law",
        "LAMMPS restores the pair style of a restart file without its cutoff, so that contacts may have no force.",
        _restart_without_law,
    ),
    Check(
        "on-periodic-face",
        "A sphere that crosses the face by rounding can corrupt a restart file.",
        _on_faces,
    ),
    Check(
        "lost-spheres",
        "Spheres that leave because of too long a step or an open face vanish without an error.",
        _ignored_loss,
    ),
)
