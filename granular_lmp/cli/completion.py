"""Make a shell script, with shtab, that completes commands, options, folders, files and names of scenes.

`Parser` reads the kind of each argument from its metavar, so new commands need no change here.
"""

import argparse
from collections.abc import Iterable, Mapping
from typing import Any

# For each shell: a function that offers names and files, and how an argument refers to it
_FUNCTIONS = {
    "bash": '{function}() {{ compgen -W "{names}" -- "$1"; compgen -f -- "$1"; }}',
    "zsh": "{function}() {{ compadd {names}; _files; }}",
    "fish": "function {function}; printf '%s\\n' {names}; __fish_complete_path (commandline -ct); end",
}
_NAMED = {"bash": "{}", "zsh": "{}", "fish": "({})"}
SHELLS = tuple(_FUNCTIONS)


class Parser(argparse.ArgumentParser):
    """Parser that selects the completion of an argument by its metavar: SCENE, DIR or FILE."""

    def add_argument(self, *names: Any, **how: Any) -> argparse.Action:
        """Add an argument as argparse does."""
        action = super().add_argument(*names, **how)
        kind = how.get("metavar")
        if kind in ("SCENE", "DIR", "FILE"):
            function = _function(self.prog.split()[-1] if kind == "SCENE" else "file")
            action.complete = {shell: _NAMED[shell].format(function) for shell in SHELLS}  # type: ignore[attr-defined]  # shtab's
        return action


def _function(name: str) -> str:
    return f"_granular_lmp_offers_{name.replace('-', '_')}"


def script(shell: str, parser: Parser, scenes: Mapping[str, Iterable[str]]) -> str:
    """Return the script for a shell.

    Parameters
    ----------
    shell : str
        One of `SHELLS`.
    parser : Parser
    scenes : mapping of str to iterable of str
        Command → names for its SCENE.
    """
    import shtab

    functions = [
        _FUNCTIONS[shell].format(function=_function(name), names=" ".join(names))
        for name, names in {**scenes, "file": ()}.items()
    ]
    return shtab.complete(parser, shell, preamble="\n".join(functions))
