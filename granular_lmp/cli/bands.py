"""Print bands and gaps of a chain, as text or JSON."""

from collections.abc import Iterator
from math import pi
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

Ranges = list[tuple[str, float, float]]


def ranges(cell: "tuple[NDArray[Any], NDArray[Any]]") -> Ranges:
    """Return the bands and gaps of a cell, ascending, as ("band", from, to) in rad/t0."""
    from granular_lmp.crystal.chain_bands import edges, gaps

    bands = edges(*cell)
    found = [("band", *each) for each in bands.tolist()] + [("gap", *each) for each in gaps(bands)]
    return sorted(found, key=lambda each: each[1:])


def as_json(found: Ranges, t0: float) -> dict[str, list[dict[str, float]]]:
    """Return the lists "band" and "gap", each range in rad/t0 and in Hz."""
    hertz = 1 / (2 * pi * t0)
    return {
        kind: [
            {"from": low, "to": high, "from_Hz": low * hertz, "to_Hz": high * hertz}
            for name, low, high in found
            if name == kind
        ]
        for kind in ("band", "gap")
    }


def as_text(found: Ranges, t0: float) -> Iterator[str]:
    """Yield a table, a line for each range."""
    hertz = 1 / (2 * pi * t0)
    yield f"{'':5}{'from (rad/t0)':>18}{'to (rad/t0)':>18}{'from (Hz)':>14}{'to (Hz)':>14}"
    for kind, low, high in found:
        yield f"{kind:5}{low:18.12f}{high:18.12f}{low * hertz:14.6g}{high * hertz:14.6g}"
