"""A scene file to begin with: a shipped scene with a comment behind each value."""

from pathlib import Path

from granular_lmp.errors import RunFolderError, one_line
from granular_lmp.scene.document import Document, note
from granular_lmp.scene.scene import Scene

_HEAD = """\
# Run it:                        granular-lmp run {file}
# What it would take:            granular-lmp check {file}
# Change one value:              granular-lmp run {file} --set wave.amplitude=0.1
# Every key, with what is allowed: docs/reference/scene.md, and granular-lmp schema for editors
# Tables that may be added:      [disorder], [[inclusion]], [absorb], [[source]], [[monitor]]

"""


def starter(scene: Document, file: str, head: str = _HEAD) -> str:
    """Return the text of a scene file; keys that take the place of another one stand in it as comments.

    `head` is its first lines, in which ``{file}`` stands for the file.
    """
    kind, section = type(scene), ""
    lines = []
    for line in scene.to_toml(full=True).splitlines():
        section = line.strip("[]") if line.startswith("[") else section
        key = f"{section}.{line.partition(' =')[0]}"
        others = [other for other, excluded in kind.exclusive.items() if excluded[0] == key]
        lines += [line, *(_commented(other, kind) for other in others)]
    return head.format(file=file) + "\n".join(lines) + "\n"


def _commented(key: str, kind: type[Document]) -> str:
    line = f"# {key.rpartition('.')[2]} = ..."
    return f"{line:30} # {note(key, kind)}"


def write_starter(path: str | Path, source: str) -> None:
    """Write the scene `source` into a new file, under the name of the file.

    Raises
    ------
    SceneError
        When there is no such scene, or the file's name is not that of a scene.
    RunFolderError
        When the file is there already or cannot be written.
    """
    scene = Scene.load(source).with_values({"name": Path(path).stem, "description": ""})
    write_new(Path(path), starter(scene, str(path)))


def write_new(path: Path, text: str) -> None:
    """Write a file that is not there yet.

    Raises
    ------
    RunFolderError
        When the file is there already or cannot be written.
    """
    try:
        with path.open("x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError as error:
        raise RunFolderError(f"{path}: is there already; choose another name") from error
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be written: {one_line(error)}") from error
