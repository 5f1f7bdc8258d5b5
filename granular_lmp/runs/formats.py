"""The format of a run folder: ``format`` of ``run.json``, a whole number that rises when a folder says more.

1. Release 0.1.0, which wrote no number.
2. Release 0.2.0.

What a folder of an earlier format does not say is what was true when it was written.
"""

from typing import Any

FORMAT = 2  # of the folders that this release writes


def format_of(info: dict[str, Any]) -> int:
    """Return the format of a folder from its ``run.json``.

    Raises
    ------
    ValueError
        If the number is none that this release reads.
    """
    found = info.get("format", 1)
    if type(found) is not int or found < 1:
        raise ValueError(f"format = {found!r}: must be a whole number from 1 to {FORMAT}")
    if found > FORMAT:
        raise ValueError(
            f"format = {found}: was written by a newer release of granular-lmp; this one reads formats up to {FORMAT}: "
            "pip install --upgrade granular-lmp"
        )
    return found
