"""Scene file to begin with: a shipped scene with a comment behind each value."""

from pathlib import Path

from granular_lmp.errors import RunFolderError, one_line
from granular_lmp.scene.declaration import Declaration
from granular_lmp.scene.document import note

_HEAD = """\
# Run it:                        granular-lmp run {file}
# Check it without a run:        granular-lmp check {file}
# Change one value:              granular-lmp run {file} --set {change}
# Every key, with what is allowed: granular-lmp {schema}
# Optional tables:               {tables}

"""
_OF_WAVE = {
    "change": "wave.amplitude=0.1",
    "schema": "schema",
    "tables": "[disorder], [[inclusion]], [absorb], [[source]], [[monitor]]",
}
_OF_STRIKE = {
    "change": "time.duration=50.0",
    "schema": "schema impact",
    "tables": "[start], [disorder], [output], [[striker]], [[inclusion]]",
}


def starter(scene: Declaration, file: str) -> str:
    """Return the text of a scene file; keys that replace another key stand in it as comments."""
    section = ""
    lines = []
    for line in scene.to_toml(full=True).splitlines():
        section = line.strip("[]") if line.startswith("[") else section
        key = f"{section}.{line.partition(' =')[0]}"
        others = [other for other, excluded in scene.layout.exclusive.items() if excluded[0] == key]
        lines += [line, *(_commented(other, scene) for other in others)]
    said = _OF_STRIKE if scene.wave is None else _OF_WAVE
    return _HEAD.format(file=file, **said) + "\n".join(lines) + "\n"


def _commented(key: str, scene: Declaration) -> str:
    line = f"# {key.rpartition('.')[2]} = ..."
    return f"{line:30} # {note(key, scene)}"


def write_starter(path: str | Path, scene: Declaration) -> None:
    """Write a scene into a new file, under the name of the file.

    Raises
    ------
    SceneError
        If the name of the file cannot be the name of a scene.
    RunFolderError
        If the file exists already or cannot be written.
    """
    path = Path(path)
    text = starter(scene.with_values({"name": path.stem, "description": ""}), str(path))
    try:
        with path.open("x", encoding="utf-8") as stream:
            stream.write(text)
        for name, pieces in scene.beside.items():
            path.with_name(name).write_text("".join(pieces), encoding="utf-8")
    except FileExistsError as error:
        raise RunFolderError(f"{path}: exists already; choose another name") from error
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be written: {one_line(error)}") from error
