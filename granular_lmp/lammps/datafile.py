"""Write and read LAMMPS data files of spheres, with every digit.

The atom style is ``sphere``. Spheres whose angle is tracked are ``hybrid sphere dipole`` in the plane, and in space
``bpm/sphere``, which has a quaternion.

The title of the section ``Atoms`` names the style with its sub-styles, from which OVITO knows the columns. ASE and
MDAnalysis do not support diameters in data files, but read snapshots. The writer gives each number in the shortest form
that reads back to the same double; the reader also accepts files of the command ``write_data``. An extra section
``wave`` holds the initial fields of each sphere (``fix property/atom``).
"""

from collections.abc import Iterator, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import RunFolderError
from granular_lmp.frozen import dataclass

# Columns of the section Atoms by atom style; LAMMPS writes the first word of the style behind the title
ATOM_COLUMNS = {
    "sphere": "id type diameter density x y z",
    "hybrid sphere dipole": "id type x y z diameter density q mux muy muz",
    "bpm/sphere": "id molecule type diameter density x y z",
    "hybrid bpm/sphere dipole": "id type x y z molecule diameter density q mux muy muz",
}
_PIECE = 1 << 15  # lines per piece of text, a few MB
# Relative to the largest value of a column: places at rest differ by less between processors. Fields of a wave have 13
# decimals, of which the last depends on the processor
_SAME, _SAME_WAVE = 1e-12, 2e-13


@dataclass(frozen=True)
class DataFile:
    """Spheres, box and wave in the units of the deck.

    Attributes
    ----------
    box : (3, 2) array
        Low and high face along x, y, z.
    kind : (N,) int array
        LAMMPS type, two for each material: odd types move, even types are held.
    types : int
        Number of types with coefficients in the deck; the last type may have no sphere.
    position : (N, 3) array
        Centres at rest.
    diameter, density : (N,) arrays
        Diameter and density of each sphere.
    wave : (N, 6) array, (N, 4) or (N, 0); in space (N, 12) or (N, 6)
        ux uy φ (ux uy if spheres do not turn) and their velocities for unit amplitude, in D0 and D0/t0; in space
        ux uy uz φx φy φz. Without columns, as without a wave, the file has no section ``wave``.
    state : (N, 9) array, (N, 6) or (0, 0)
        Section ``state``, in space together with a wave: displacements, velocities and spins in units of the deck.
    style : str
        Atom style, a key of `ATOM_COLUMNS`.
    """

    box: NDArray[np.float64]
    kind: NDArray[np.int64]
    position: NDArray[np.float64]
    diameter: NDArray[np.float64]
    density: NDArray[np.float64]
    wave: NDArray[np.float64]
    types: int = 2
    style: str = "hybrid sphere dipole"
    state: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 0)))

    def pieces(self, title: str) -> Iterator[str]:
        """Yield the file, one line per sphere, in pieces of a few MB, so that a million spheres need little memory.

        Every sphere points along +x at rest, and its dipole records the angle.
        """
        faces = "\n".join(
            f"{low!r} {high!r} {axis}lo {axis}hi" for axis, (low, high) in zip("xyz", self.box.tolist(), strict=True)
        )
        columns = {"type": self.kind, "diameter": self.diameter, "density": self.density}
        columns |= {"molecule": np.ones_like(self.kind)}
        columns |= dict(zip("xyz", self.position.T, strict=True))
        own = [columns[name] for name in ATOM_COLUMNS[self.style].split() if name in columns]
        yield f"{title}\n\n{len(self.kind)} atoms\n{self.types} atom types\n\n{faces}\n\n"
        yield f"# {ATOM_COLUMNS[self.style]}\nAtoms # {self.style}\n\n"
        yield from _lines(own, tail=" 0 1 0 0\n" if self.style.endswith("dipole") else "\n")
        for name, section in (("wave", self.wave), ("state", self.state)):
            if section.size:
                yield f"\n{name}\n\n"
                yield from _lines([*section.T], tail="\n")

    def text(self, title: str) -> str:
        """Return the whole file as one string."""
        return "".join(self.pieces(title))


def differences(written: DataFile, data: DataFile) -> list[str]:
    """Return the differences between the written and another data file, "- ..." and "+ ..."; rounding is ignored.

    For each quantity they name the first sphere that differs.
    """
    was, now = _shape_of(written), _shape_of(data)
    if was != now:
        return [f"- {was}", f"+ {now}"]
    found = []
    for name in ("box", "kind", "position", "diameter", "density", "wave", "state"):
        ours, theirs = np.atleast_1d(getattr(written, name)), np.atleast_1d(getattr(data, name))
        largest = np.abs(ours).max(axis=0, initial=0.0)
        off = ~(np.abs(theirs - ours) <= (_SAME_WAVE if name == "wave" else _SAME * largest))
        if off.any():
            first = tuple(np.argwhere(off)[0].tolist())
            where = "face" if name == "box" else "sphere"
            said = f"{name} of {where} {first[0] + 1}"
            found += [f"- {said}: {ours[first].item()!r}", f"+ {said}: {theirs[first].item()!r}"]
    return found


def _shape_of(data: DataFile) -> str:
    fields = f"{data.wave.shape[1]} columns of wave, {data.state.shape[1]} of state"
    return f"{len(data.kind)} spheres of {data.types} types, atom style {data.style}, {fields}"


def _lines(columns: Sequence[NDArray[Any]], tail: str) -> Iterator[str]:
    """Yield lines "number column column … tail", numbered from 1, `_PIECE` at a time."""
    count = len(columns[0])
    for start in range(0, count, _PIECE):
        stop = min(start + _PIECE, count)
        words = [map(str, range(start + 1, stop + 1)), *(_shortest(column[start:stop]) for column in columns)]
        yield tail.join(map(" ".join, zip(*words, strict=True))) + tail


def _shortest(values: NDArray[Any]) -> list[str]:
    """Return each number in the shortest form that reads back to the same bits.

    Each different number is converted once, because spheres of a row share most numbers and conversion is slower than
    the search for equal numbers. The comparison as integers distinguishes −0.0 from 0.0.
    """
    different, place = np.unique(np.ascontiguousarray(values).view(np.int64), return_inverse=True)
    words = np.array([repr(value) for value in different.view(values.dtype).tolist()], dtype=object)
    return words[place].tolist()


def id_ranges(spheres: NDArray[np.int64]) -> str:
    """Return the identifiers of spheres, from ascending indices, for ``group NAME id``: "4 7:9"."""
    runs = np.split(spheres + 1, np.flatnonzero(np.diff(spheres) != 1) + 1)
    return " ".join(f"{run[0]}:{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)


def read(path: str | Path) -> DataFile:
    """Read a data file made by `DataFile.text`, or by the command ``write_data`` with the same atom style.

    Returns
    -------
    DataFile
        ``wave`` is an empty array, (N, 0), if the file has no section ``wave``.

    Raises
    ------
    RunFolderError
        If the file cannot be read, a section is missing or a line is malformed.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        header, sections = _sections(text)
        count, types = [
            next(int(line.split()[0]) for line in header if line.split()[1:] == words)
            for words in (["atoms"], ["atom", "types"])
        ]
        box = [next(line.split()[:2] for line in header if line.endswith(f"{axis}hi")) for axis in "xyz"]
        style = _style(next(line for line in text.splitlines() if line.startswith("Atoms #")))
        names = ATOM_COLUMNS[style].split()
        lines = np.array([line.split()[: len(names)] for line in sections["Atoms"]], dtype=float)
        atoms = dict(zip(names, lines[np.argsort(lines[:, 0])].T, strict=True))
        wave, state = (
            np.array([line.split() for line in sections.get(name, [])], dtype=float) for name in ("wave", "state")
        )
        if len(lines) != count or {len(wave), len(state)} - {0, count}:
            raise ValueError(f"{count} atoms announced, {len(lines)} found")
    except (OSError, ValueError, KeyError, IndexError, StopIteration) as error:
        raise RunFolderError(f"{path}: not a data file of spheres: {error!r}") from error
    return DataFile(
        box=np.array(box, dtype=float),
        kind=atoms["type"].astype(int),
        position=np.column_stack([atoms["x"], atoms["y"], atoms["z"]]),
        diameter=atoms["diameter"],
        density=atoms["density"],
        types=types,
        wave=_by_number(wave) if len(wave) else np.empty((count, 0)),
        state=_by_number(state) if len(state) else np.empty((0, 0)),
        style=style,
    )


def _by_number(section: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the columns of a section in the order of the spheres."""
    return np.asarray(section[np.argsort(section[:, 0])][:, 1:])


def _style(title: str) -> str:
    """Return the atom style of a title; for files that LAMMPS wrote, the first that fits.

    Files before version 0.3 have the columns behind its first word.
    """
    named, _, columns = title.partition("#")[2].strip(" )").partition(" (")
    fits = [style for style in ATOM_COLUMNS if style.split()[0] == named.split()[0]]
    return next((style for style in fits if named == style or columns == ATOM_COLUMNS[style]), fits[0])


def _sections(text: str) -> tuple[list[str], dict[str, list[str]]]:
    """Return the header lines, and the lines of each section by the first word of its title."""
    header: list[str] = []
    sections: dict[str, list[str]] = {}
    lines = header
    for line in filter(None, (raw.partition("#")[0].strip() for raw in text.splitlines()[1:])):
        if line.isalpha():
            lines = sections.setdefault(line, [])
        else:
            lines.append(line)
    return header, sections
