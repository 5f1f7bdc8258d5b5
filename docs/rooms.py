"""Draw the rooms of the package and who imports whom, from the sources: ``make rooms`` writes ``figures/rooms.svg``.

An arrow leads from a room to one that imports from it, in the direction of the data. An import that a chain of other
arrows implies is left out, and so are ``errors`` and ``frozen``, which every room imports.
"""

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from html import escape
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "granular_lmp"
DRAWING = ROOT / "figures" / "rooms.svg"
LEFT_OUT = {"errors", "frozen"}
Arrows = set[tuple[str, str]]

_WIDTH, _BOX, _HEIGHT, _STEP, _LEFT = 980, 130, 30, 52, 150


# Only these statements are parsed
_IMPORT = re.compile(r"^[ \t]*((?:from|import)[ \t]+granular_lmp\b(?:[^\n(]*\([^)]*\)|[^\n]*))", re.MULTILINE)


@cache
def imported(source: str) -> set[str]:
    """Return the rooms of the package that a source imports; in ``analysis``, those of ``granular_lmp`` too."""
    names: set[str] = set()
    for node in ast.parse("\n".join(_IMPORT.findall(source))).body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name.split(".")[1] for name in names if name.startswith("granular_lmp.")}


def sentence(source: str) -> str:
    """Return the first sentence of a docstring, without its marks of code."""
    text = " ".join((ast.get_docstring(ast.parse(source)) or "").split()).replace("`", "")
    return text.split(". ")[0].rstrip(".") + "."


def rooms() -> dict[str, list[Path]]:
    """Return the modules of each room: a folder of the package, or a module beside the folders."""
    found: dict[str, list[Path]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        room = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if not room.startswith("_") and room not in LEFT_OUT:
            found.setdefault(room, []).append(path)
    return found


def arrows() -> Arrows:
    """Return the pairs of different rooms, imported and importing."""
    known = rooms()
    found = {
        (used, room) for room, paths in known.items() for path in paths for used in imported(path.read_text("utf-8"))
    }
    return {(used, room) for used, room in found if used in known and used != room}


def reduced(pairs: Arrows) -> Arrows:
    """Return the arrows that no chain of two or more others implies."""

    def reaches(start: str, end: str) -> bool:
        return any(second == end or reaches(second, end) for first, second in pairs if first == start)

    return {(a, b) for a, b in pairs if not any(first == a and c != b and reaches(c, b) for first, c in pairs)}


def order(pairs: Arrows) -> list[str]:
    """Return the rooms from the first that is imported to the last that imports; equals by their names."""
    graph = TopologicalSorter({room: sorted(used for used, other in pairs if other == room) for room in rooms()})
    graph.prepare()
    found: list[str] = []
    while graph.is_active():
        ready = sorted(graph.get_ready())
        found += ready
        graph.done(*ready)
    return found


def drawing() -> str:
    """Return the drawing as SVG."""
    chain, pairs = order(arrows()), reduced(arrows())
    says = {room: sentence(paths[0].read_text("utf-8")) for room, paths in rooms().items()}
    analysis = sorted((ROOT / "analysis/granular_analysis").rglob("*.py"))
    taken = {room for path in analysis for room in imported(path.read_text("utf-8"))}
    says["analysis"] = (
        "The independent theory, compared with runs; of the package it takes records, tables, sphere and entry only."
    )
    places = {room: 20 + _STEP * i for i, room in enumerate([*chain, "analysis"])}
    height = places["analysis"] + _HEIGHT + 20
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" font-family="sans-serif">',
        '<marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 8 4 0 8Z" fill="#37474f"/></marker>',
        f'<rect width="{_WIDTH}" height="{height}" rx="6" fill="#ffffff"/>',
    ]
    lines += [_arrow(places[used], places[room], dashed=False) for used, room in sorted(pairs)]
    lines += [_arrow(places[room], places["analysis"], dashed=True) for room in sorted(taken)]
    lines += [_box(room, place, says[room]) for room, place in places.items()]
    return "\n".join([*lines, "</svg>"]) + "\n"


def _box(room: str, place: int, says: str) -> str:
    fill = "#fff3e0" if room == "analysis" else "#e3edf2"
    return (
        f'<rect x="{_LEFT}" y="{place}" width="{_BOX}" height="{_HEIGHT}" rx="4" fill="{fill}" stroke="#37474f"/>'
        f'<text x="{_LEFT + _BOX / 2:g}" y="{place + 20}" text-anchor="middle" font-size="14">{room}</text>'
        f'<text x="{_LEFT + _BOX + 16}" y="{place + 20}" font-size="12" fill="#37474f">{escape(says)}</text>'
    )


def _arrow(start: int, end: int, dashed: bool) -> str:
    """Return an arrow between two boxes: straight down to the next one, else around those between."""
    style = 'fill="none" stroke="#37474f" marker-end="url(#tip)"' + (' stroke-dasharray="5 4"' if dashed else "")
    if end - start == _STEP and not dashed:
        middle = _LEFT + _BOX // 2
        return f'<path d="M{middle} {start + _HEIGHT}V{end}" {style}/>'
    away = _LEFT - 14 - 12 * (end - start) // _STEP
    top, bottom = start + _HEIGHT // 2, end + _HEIGHT // 2
    return f'<path d="M{_LEFT} {top}C{away} {top} {away} {bottom} {_LEFT} {bottom}" {style}/>'


if __name__ == "__main__":
    DRAWING.write_text(drawing(), encoding="utf-8")
