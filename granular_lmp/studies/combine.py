"""Find out whether two features of a scene can be combined: build a small deck with both, or report the error.

An error is either physics, and permanent, or not built (`granular_lmp.rest.refusals`). Settings that exclude each
other, such as two lattices, are neither.
"""

from typing import Any, NamedTuple

from granular_lmp.accuracy.ladder import build
from granular_lmp.errors import SceneError
from granular_lmp.scene.files import assignment
from granular_lmp.scene.schema import allowed_names
from granular_lmp.studies.features import KINDS, Kind, Settings

BUILDS, PHYSICS, NOT_BUILT, EXCLUSIVE = "builds", "physics", "not built", "exclusive"
_SAID = {
    BUILDS: "go together",
    PHYSICS: "cannot go together",
    NOT_BUILT: "do not go together yet",
    EXCLUSIVE: "exclude each other",
}


class Outcome(NamedTuple):
    """Outcome of features in one scene: one of four words, and the message of a refusal."""

    word: str
    message: str = ""


def together(*settings: Settings) -> dict[str, Any]:
    """Return several settings as one, with lists of tables joined.

    Raises
    ------
    SceneError
        If they give two values to one key.
    """
    joined: dict[str, Any] = {}
    for key, value in (item for each in settings for item in each.items()):
        if isinstance(value, list) and key != "start.state":
            joined[key] = [*joined.get(key, []), *value]
        elif (held := joined.setdefault(key, value)) != value:
            raise SceneError(f"both set {key}, to {held!r} and {value!r}", because="exclusive")
    return joined


def outcome(kind: Kind, *settings: Settings) -> Outcome:
    """Return the outcome of features, each given by its settings, in one scene.

    Raises
    ------
    SceneError
        If a single value is wrong in any scene.
    """
    try:
        deck = build(kind.scene.with_values(together(*settings)))
    except SceneError as error:
        if error.because is None:
            raise
        return Outcome(error.because, str(error))
    deck.files()
    return Outcome(BUILDS)


def answers(one: str, other: str) -> list[str]:
    """Return one sentence on whether two features can be combined, or two if kinds of scenes differ.

    Parameters
    ----------
    one, other : str
        Each the name of a feature, a key that only one feature sets, or a setting ``KEY=VALUE``.

    Raises
    ------
    SceneError
        If a name is unknown, or if no kind of scene has both features.
    """
    words = _name(one), _name(other)
    found: dict[Outcome, list[str]] = {}
    wrong = []
    for kind in KINDS:
        try:
            made = outcome(kind, *(_settings(kind, each) for each in dict.fromkeys(words)))
        except SceneError as error:
            wrong.append(str(error))
        else:
            found.setdefault(made, []).append(kind.words)
    if not found:
        raise SceneError("; ".join(dict.fromkeys(wrong)))
    return [
        f"In a scene {' or '.join(kinds)}, {' and '.join(words)} {_SAID[word]}{message and ': '}{message}."
        for (word, message), kinds in found.items()
    ]


def _name(word: str) -> str:
    """Return a feature as spelled in the lists, or an unchanged setting ``KEY=VALUE``."""
    if "=" in word:
        return word
    features = [feature for kind in KINDS for feature in kind.features.items()]
    names = dict.fromkeys(name for name, _ in features)
    spelled = word.replace("-", " ").replace("_", " ").lower()
    if spelled in names:
        return spelled
    having = [*dict.fromkeys(name for name, settings in features if word in settings)]
    if len(having) == 1:
        return having[0]
    if having:
        raise SceneError(f"{word}: several features set it: {', '.join(having)}; name one, or give {word}=VALUE")
    near = dict.fromkeys(key for _, settings in features for key in settings) if "." in word else names
    raise SceneError(f"feature {word!r} is unknown, and is no setting, KEY=VALUE; {allowed_names(spelled, near)}")


def _settings(kind: Kind, word: str) -> Settings:
    if "=" in word:
        return dict([assignment(word)])
    if word not in kind.features:
        raise SceneError(f"feature {word!r} does not belong to a scene {kind.words}")
    return kind.features[word]
