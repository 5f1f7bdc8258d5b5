"""Allowed values of each field of ``run.json``: one declaration, against which the file is checked when it is read.

A field may be missing, as a run that was stopped says less; a reader that cannot do without it says so. What is not
declared here is not read either.
"""

from collections.abc import Callable, Mapping
from typing import Any

from granular_lmp.runs.components import NAMES
from granular_lmp.scene.schema import shown

Check = Callable[[str, Any], None]  # takes a dotted key and its value; raises ValueError

LAUNCHERS = ("module", "lmp")
STATES = ("finished", "failed", "interrupted", "running")
_LARGEST = 1e308  # JSON of Python may hold nan, inf and whole numbers that no double holds


def _plain(words: str, fits: Callable[[Any], bool]) -> Check:
    def check(key: str, value: Any) -> None:
        if not fits(value):
            raise ValueError(f"{key} = {shown(value)}: must be {words}")

    return check


def _or_null(check: Check) -> Check:
    return lambda key, value: None if value is None else check(key, value)


def _list_of(check: Check) -> Check:
    def check_all(key: str, value: Any) -> None:
        _LIST(key, value)
        for number, each in enumerate(value, 1):
            check(f"{key}.{number}", each)

    return check_all


def _table_of(check: Check) -> Check:
    def check_all(key: str, value: Any) -> None:
        _TABLE(key, value)
        for name, each in value.items():
            check(f"{key}.{name}", each)

    return check_all


def _entries(required: Mapping[str, Check], optional: Mapping[str, Check] | None = None) -> Check:
    """Return the check of an object with these entries; what is not named may be anything."""
    known = {**required, **(optional or {})}

    def check(key: str, value: Any) -> None:
        _TABLE(key, value)
        if not required.keys() <= value.keys():
            raise ValueError(f"{key}: must hold {', '.join(sorted(required))}")
        for name in known.keys() & value.keys():
            known[name](f"{key}.{name}", value[name])

    return check


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and -_LARGEST < value < _LARGEST


def _one_of(allowed: tuple[str, ...]) -> Check:
    return _plain(f"one of {', '.join(allowed)}", lambda value: isinstance(value, str) and value in allowed)


_LIST = _plain("a list", lambda value: isinstance(value, list))
_TABLE = _plain("a JSON object", lambda value: isinstance(value, dict))
_TEXT = _plain("a string", lambda value: isinstance(value, str))
_FLAG = _plain("true or false", lambda value: isinstance(value, bool))
_NUMBER = _plain("a number", _is_number)
_MAYBE = _or_null(_NUMBER)
_COUNT = _plain("a whole number", lambda value: type(value) is int and 0 <= value < _LARGEST)
_RANKS = _plain("a whole number above 0", lambda value: type(value) is int and 0 < value < _LARGEST)
_PAIR = _plain(
    "a number and its error", lambda value: isinstance(value, list) and len(value) == 2 and all(map(_is_number, value))
)

_EFFECT = _entries({"on": _FLAG, "called_for": _FLAG, "guard": _TEXT}, {"number": _MAYBE, "reason": _TEXT})
_GUARD = _entries(
    {"effect": _TEXT, "quiet": _FLAG, "value": _MAYBE, "meaning": _TEXT, "judges": _FLAG},
    {"bound": _MAYBE, "limit": _NUMBER, "passed_at": _MAYBE, "cure": _TEXT},
)
_MONITOR = _entries(
    {},
    {
        **{"why": _TEXT, "frequency": _NUMBER, "from": _NUMBER, "to": _NUMBER},
        **dict.fromkeys(NAMES, _table_of(_PAIR)),
    },
)
_SECONDS = _entries({}, {"total": _NUMBER, "loop": _MAYBE, "other": _MAYBE, "phases": _table_of(_NUMBER)})
_BUDGET = _entries({"name": _TEXT, "p": _MAYBE, "q": _MAYBE, "phi": _MAYBE, "to_halve": _TEXT})
_QUIET = _entries({"rows": _COUNT, "strength": _NUMBER, "power": _NUMBER, "ends": _list_of(_TEXT)})
_CRYSTAL = _entries({}, {"contacts_per_sphere": _NUMBER})

FIELDS: dict[str, Check] = {
    name: check
    for check, names in (
        (_one_of(STATES), "status"),
        (_one_of(LAUNCHERS), "launcher"),
        (_RANKS, "ranks"),
        (_TEXT, "message name scene_sha256 trajectory_sha256 sealed"),
        (_COUNT, "format particles recorded steps samples centre order"),
        (_NUMBER, "timestep_used wavenumber_used direction_used frequency amplitude tolerance"),
        (_NUMBER, "epsilon overlap_ratio Delta0_m t0_s length_m velocity_m_s mass_kg shortest_collision"),
        (_MAYBE, "smallest_overlap"),
        (_list_of(_TEXT), "edited refinements remarks accepted"),
        (_list_of(_NUMBER), "extrapolated_from"),
        (_table_of(_TEXT), "kernel"),
        (_table_of(_or_null(_TEXT)), "versions"),
        (_table_of(_NUMBER), "looks at_rest"),
        (_table_of(_MAYBE), "error_estimate errors_of_monitors noise"),
        (_table_of(_EFFECT), "effects"),
        (_table_of(_GUARD), "guards"),
        (_table_of(_MONITOR), "monitors"),
        (_list_of(_BUDGET), "error_budget"),
        (_SECONDS, "wall_seconds"),
        (_CRYSTAL, "crystal"),
        (_QUIET, "quiet_ends"),
        (_table_of(_entries({"bytes": _COUNT, "sha256": _TEXT})), "files"),
        (_entries({"from": _TEXT, "variables": _table_of(_TEXT)}), "adopted"),
    )
    for name in names.split()
}


def refuse_malformed(info: Mapping[str, Any]) -> None:
    """Raise ValueError if a field of ``run.json`` holds what it must not; the text names the field and what may."""
    if "status" not in info:
        raise ValueError("status: missing key")
    for key, check in FIELDS.items():
        if key in info:
            check(key, info[key])
