"""A script for bash that completes commands, options, and the names of shipped scenes; made from the parser."""

import argparse
from collections.abc import Iterable, Mapping

_SCRIPT = """\
# For bash: source <(granular-lmp completion bash)
_granular_lmp() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" words
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="{commands}"
    else
        case "${{COMP_WORDS[1]}}" in
{cases}
        esac
    fi
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _granular_lmp granular-lmp"""


def bash(
    commands: Mapping[str, argparse.ArgumentParser], names: Mapping[str, Iterable[str]], scenes: Iterable[str]
) -> str:
    """Return the script.

    Parameters
    ----------
    commands : mapping of str to ArgumentParser
    names : mapping of str to iterable of str
        Command → what its SCENE may be, where that is not one of the scenes.
    scenes : iterable of str
        Names for the SCENE of the other commands.
    """
    cases = []
    for name, parser in commands.items():
        words = [option for action in parser._actions for option in action.option_strings]
        for action in parser._actions:
            words += action.choices or (names.get(name, scenes) if action.metavar == "SCENE" else ())
        cases.append(f'        {name}) words="{" ".join(words)}" ;;')
    return _SCRIPT.format(commands=" ".join(["--help", "--version", *commands]), cases="\n".join(cases))
