"""Outcomes of two features in one scene, and the golden files that hold them.

A deck is built, or a message says why not. Each message is either physics, which stays refused, or not built, which
is open: `REFUSALS` says which, and an unknown message is an error. Settings that exclude each other by themselves, two
lattices say, are none of both. A golden file may only gain: `update` takes no pair away.
"""

import re
from collections.abc import Iterator
from pathlib import Path

from granular_lmp import build
from granular_lmp.errors import CrystalError, SceneError
from tests.matrix.features import Kind, Settings, together

BUILDS, PHYSICS, NOT_BUILT, EXCLUSIVE = ".", "P", "N", "x"
MEANING = {BUILDS: "builds", PHYSICS: "physics", NOT_BUILT: "not built", EXCLUSIVE: "exclusive"}
GOLDEN = Path(__file__).parent

# What a message says → why the pair does not build
REFUSALS: dict[str, str] = {
    # waves
    r"which has no shear stiffness without friction and would collapse": PHYSICS,
    r'adhesion_law = "jkr": needs sphere.work_of_adhesion above 0': PHYSICS,
    r'wave.direction = .*: must be "y" with packing.lattice = "chain"': PHYSICS,
    r"envelope.length = .* and envelope.width = .*: must be both 0 or both above in wave.direction": PHYSICS,
    r"effects.viscosity = .* and effects.restitution = .*: two models": PHYSICS,
    r"effects.sliding = true: .*effects.shear": PHYSICS,
    r"wave.mode = 'TR': .*frequency 0": PHYSICS,
    r'force = "torque": .*effects.rotation, which is off': PHYSICS,
    r"packing.contact_force = .*: must be 0 in a honeycomb lattice, which would buckle": PHYSICS,
    r"absorb.rows = .*quiet ends are for rows of one sphere a cell": NOT_BUILT,
    r'wave.direction = .*: must be "y" with wave.form = "driven"': NOT_BUILT,
    r'envelope.(length|width) = .*: must be 0 with wave.form = "none"': PHYSICS,
    r'envelope.(length|width) = .*: must be 0 with wave.form = "driven"': NOT_BUILT,
    r"absorb.rows = .*: no number of rows absorbs the long waves of a strike": PHYSICS,
    r"packing.contact_force = .*: must be 0 with free faces": PHYSICS,
    r'packing.sides = "held": must be "free" or left out in a chain': PHYSICS,
    r'packing.first = .free.: must be "held" or "auto" with wave.form = "driven"': PHYSICS,
    r"must lie between the faces that are held|is at a face that is held|for a sphere of a held row": PHYSICS,
    r"absorb.rows = .*both ends are free or walls": NOT_BUILT,
    # impacts
    r"^effects.\w+: unknown key": NOT_BUILT,
    r'packing.(first|last) = "wall": must be "held" or "free" in a crystal at rest with': NOT_BUILT,
    r"effects.restitution = .*: LAMMPS has it for contacts without adhesion only": PHYSICS,
    r'packing.(first|last) = .*: must be "(auto|free)" with packing.ends = "periodic"': PHYSICS,
    r'packing.sides = "periodic": must be 1 and "free" in a chain': PHYSICS,
    r"vacancy = true: .*in a chain": PHYSICS,
    r"effects.friction = .*in a chain": PHYSICS,
    r"radius = .*in a sheet": NOT_BUILT,
    r"start.touching = true: needs": PHYSICS,
    r"source: has no unit of time where nothing is at rest": PHYSICS,
    r"absorb: absorbs linear waves, and contacts without load have none": PHYSICS,
    r"packing.ends: must be packing.first and packing.last": NOT_BUILT,
    r"start.touching = true: must be false beside .wave.": PHYSICS,
    r"effects.restitution = .*: must be 1 with sphere.work_of_adhesion": PHYSICS,
    r"^output.forces: unknown key": EXCLUSIVE,
}


def pattern_of(message: str) -> str:
    """Return the line of `REFUSALS` that knows a message; LookupError if none does."""
    for pattern in REFUSALS:
        if re.search(pattern, message):
            return pattern
    raise LookupError(f"no line of REFUSALS says whether this is physics or not built: {message}")


def reason(message: str) -> str:
    """Return why a message refuses a pair; LookupError if no line of `REFUSALS` knows it."""
    return REFUSALS[pattern_of(message)]


_SAID: dict[tuple[str, str], str] = {}  # messages by kind and settings: the page and its tests ask for them again


def message(kind: Kind, settings: Settings) -> str:
    """Return why a scene with these settings is refused; "" if its deck is built."""
    key = kind.name, repr(settings)
    if key not in _SAID:
        _SAID[key] = _message(kind, settings)
    return _SAID[key]


def _message(kind: Kind, settings: Settings) -> str:
    try:
        scene = kind.scene.with_values(settings)
        deck = build(scene)
    except (SceneError, CrystalError) as error:
        return str(error)
    assert deck.files()
    return ""


def outcome(kind: Kind, one: str, other: str) -> str:
    """Return what becomes of two features in one scene; of a feature and itself that of it alone."""
    settings = pair(kind, one, other)
    if settings is None:
        return EXCLUSIVE
    refused = message(kind, settings)
    return reason(refused) if refused else BUILDS


def pair(kind: Kind, one: str, other: str) -> Settings | None:
    """Return the settings of two features, or of one; None if they exclude each other."""
    return together(*(kind.features[name] for name in dict.fromkeys((one, other))))


def row(kind: Kind, name: str) -> str:
    """Return the outcomes of a feature with those before it, and alone."""
    names = [*kind.features]
    return "".join(outcome(kind, name, other) for other in names[: names.index(name) + 1])


# --- golden files ----------------------------------------------------------------------------------------------------

Rows = dict[str, str]  # feature → its outcomes with those before it, and alone


def text(rows: Rows) -> str:
    """Return rows as a golden file holds them."""
    lines = (f"{number:2} {name:16} {' '.join(line)}" for number, (name, line) in enumerate(rows.items(), 1))
    return "\n".join([", ".join(f"{symbol} {said}" for symbol, said in MEANING.items()), *lines]) + "\n"


def golden(kind: str) -> Rows:
    """Return the rows of a golden file."""
    lines = (GOLDEN / f"{kind}.txt").read_text("utf-8").splitlines()[1:]
    return {line[3:19].strip(): line[20:].replace(" ", "") for line in lines}


def losses(before: Rows, now: Rows) -> Iterator[str]:
    """Yield each pair that is not as good as it was: whatever changes must build now."""
    for name, line in before.items():
        if name not in now:
            yield f"{name}: is gone"
        for other, old, new in zip(before, line, now.get(name, line), strict=False):
            if old != new and new != BUILDS:
                yield f"{name} + {other}: {MEANING[old]} before, {MEANING[new]} now"


def gains(before: Rows, now: Rows) -> Iterator[str]:
    """Yield each pair that is better than it was, and each feature that is new."""
    for name, line in now.items():
        if name not in before:
            yield f"{name}: is new"
        elif before[name] != line and not [*losses({name: before[name]}, {name: line})]:
            yield f"{name}: {before[name]} before, {line} now"


def update(before: Rows, now: Rows) -> Rows:
    """Return what a golden file may hold from now on.

    Raises
    ------
    ValueError
        If a pair is worse than before. Who means it edits the file, and says in its commit why.
    """
    if lost := [*losses(before, now)]:
        raise ValueError("a golden file may only gain: " + "; ".join(lost))
    return now
