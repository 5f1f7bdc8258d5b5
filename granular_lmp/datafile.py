"""LAMMPS data files of spheres (``atom_style sphere``, with a direction ``hybrid sphere dipole``), every digit kept.

ASE has no sphere style. The writer gives each number in the shortest form that reads back to the same double; the
reader also takes what LAMMPS's ``write_data`` writes. An extra section ``wave`` carries a field per particle (``fix
property/atom``).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import RunFolderError

# Of a line of the section Atoms, by the word that LAMMPS writes behind its title
COLUMNS = {
    "sphere": "id type diameter density x y z",
    "hybrid": "id type x y z diameter density q mux muy muz",
}


@dataclass(frozen=True)
class DataFile:
    """Spheres, box and wave in the units of the deck.

    Attributes
    ----------
    box : (3, 2) array
        Low and high face along x, y, z.
    kind : (N,) int array
        LAMMPS type: 1 moves, 2 is held.
    position : (N, 3) array
    diameter, density : (N,) arrays
    wave : (N, 6) array, or (N, 4)
        ux uy φ (without rotation ux uy) and their velocities for unit amplitude, in D0 and D0/t0.
    directed : bool
        Whether the spheres carry a direction (a dipole).
    """

    box: NDArray[np.float64]
    kind: NDArray[np.int64]
    position: NDArray[np.float64]
    diameter: NDArray[np.float64]
    density: NDArray[np.float64]
    wave: NDArray[np.float64]
    directed: bool = True

    def text(self, title: str) -> str:
        """The file, one line a sphere; every sphere points along +x (the dipole is the hand of its clock)."""
        count = len(self.kind)
        faces = "\n".join(
            f"{low!r} {high!r} {axis}lo {axis}hi" for axis, (low, high) in zip("xyz", self.box.tolist(), strict=True)
        )
        columns = (self.kind, self.position, self.diameter, self.density)
        spheres = zip(*(column.tolist() for column in columns), strict=True)
        style = "hybrid" if self.directed else "sphere"
        atoms = "\n".join(
            f"{i} {kind} {x!r} {y!r} {z!r} {diameter!r} {density!r} 0 1 0 0"
            if self.directed
            else f"{i} {kind} {diameter!r} {density!r} {x!r} {y!r} {z!r}"
            for i, (kind, (x, y, z), diameter, density) in enumerate(spheres, start=1)
        )
        wave = "\n".join(f"{i} " + " ".join(map(repr, row)) for i, row in enumerate(self.wave.tolist(), start=1))
        return (
            f"{title}\n\n{count} atoms\n2 atom types\n\n{faces}\n\n"
            f"Atoms # {style} ({COLUMNS[style]})\n\n{atoms}\n\n"
            f"wave\n\n{wave}\n"
        )


def read(path: str | Path) -> DataFile:
    """Read a data file of `DataFile.text`, or of LAMMPS's ``write_data`` with the same atom style.

    Raises
    ------
    RunFolderError
        When the file cannot be read, a section is missing or a line is malformed. A file without the section ``wave``
        gives an empty ``wave`` array, (0, 0).
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        header, sections = _sections(text)
        count = int(next(line.split()[0] for line in header if line.split()[1:] == ["atoms"]))
        box = [next(line.split()[:2] for line in header if line.endswith(f"{axis}hi")) for axis in "xyz"]
        style = next(line.split()[2] for line in text.splitlines() if line.startswith("Atoms #"))
        names = COLUMNS[style].split()
        lines = np.array([line.split()[: len(names)] for line in sections["Atoms"]], dtype=float)
        atoms = dict(zip(names, lines[np.argsort(lines[:, 0])].T, strict=True))
        wave = np.array([line.split() for line in sections.get("wave", [])], dtype=float)
        if len(lines) != count or len(wave) not in (0, count):
            raise ValueError(f"{count} atoms announced, {len(lines)} found")
    except (OSError, ValueError, KeyError, IndexError, StopIteration) as error:
        raise RunFolderError(f"{path}: not a data file of spheres: {error!r}") from error
    return DataFile(
        box=np.array(box, dtype=float),
        kind=atoms["type"].astype(int),
        position=np.column_stack([atoms["x"], atoms["y"], atoms["z"]]),
        diameter=atoms["diameter"],
        density=atoms["density"],
        wave=wave[np.argsort(wave[:, 0])][:, 1:] if len(wave) else np.empty((0, 0)),
        directed=style == "hybrid",
    )


def _sections(text: str) -> tuple[list[str], dict[str, list[str]]]:
    """Header lines, and the lines of each section by the first word of its title."""
    header: list[str] = []
    sections: dict[str, list[str]] = {}
    lines = header
    for line in filter(None, (raw.partition("#")[0].strip() for raw in text.splitlines()[1:])):
        if line.isalpha():
            lines = sections.setdefault(line, [])
        else:
            lines.append(line)
    return header, sections
