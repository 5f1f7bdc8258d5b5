"""Commands on decks of other origin: lint."""

from typing import TYPE_CHECKING, Any

from granular_lmp.cli.arguments import Commands, Options, add, json_argument, variables_argument
from granular_lmp.cli.output import remark, say, say_json
from granular_lmp.errors import DeckError

if TYPE_CHECKING:
    from granular_lmp.foreign.finding import Check, Finding
    from granular_lmp.foreign.reading import Reading


def add_to(commands: Commands) -> None:
    """Add these commands to the parser."""
    lint = add(commands, "lint", _lint, "warn about likely errors in a granular deck of any origin, without a run")
    lint.add_argument("deck", metavar="DECK", help="input file, as for 'lmp -in'")
    variables_argument(lint)
    lint.add_argument("--strict", action="store_true", help="exit with status 1 if there is a warning")
    json_argument(lint)


def _lint(options: Options) -> int:
    from granular_lmp.foreign.apart import read_apart
    from granular_lmp.foreign.lint import lint

    reading = read_apart(options.deck, dict(options.variables))
    found = lint(reading)
    if reading.stopped and not (found or reading.stages):
        raise DeckError(reading.stopped)
    if reading.stopped:
        remark(f"note: {reading.stopped}; the rest of the deck was not read")
    if reading.start and not reading.start.exact:
        remark(f"note: {options.deck}: contacts are judged before a minimization, which was not done")
    for law in {str(law.command): law for law in reading.laws.values() if law.unread}.values():
        remark(f"note: {law.command.place}: no check knows {law.unread}; contacts are judged without it")
    if not reading.stages:
        remark(f"note: {options.deck}: the deck has no run, so contacts and steps could not be judged")
    elif reading.spheres is None:
        remark(f"note: {options.deck}: there were no spheres at the first long run, so no contact could be judged")
    if not reading.is_granular:
        remark(f"note: {options.deck}: the deck does not use pair_style granular or gran/..., so nothing was judged")
    if options.json:
        say_json([_row(*each) for each in found])
    else:
        for check, finding in found:
            say(f"{_place(finding)}warning: {finding.what} [{check.name}]\n    {check.why}\n    mend: {finding.mend}")
        say(f"{options.deck}: {_read(reading)}; warnings: {len(found)}")
    return int(options.strict and bool(found))


def _place(finding: "Finding") -> str:
    return f"{finding.command.place}: " if finding.command else ""


def _row(check: "Check", finding: "Finding") -> dict[str, Any]:
    command = finding.command
    return {
        "check": check.name,
        "file": command and command.file,
        "line": command and command.line,
        "command": command and str(command),
        "what": finding.what,
        "why": check.why,
        "size": finding.size,
        "mend": finding.mend,
    }


def _read(reading: "Reading") -> str:
    if reading.spheres is None or reading.pairs is None:
        return f"{len(reading.commands)} commands"
    touching = int((reading.pairs.overlap > 0).sum())
    return f"{len(reading.spheres.id)} spheres, {touching} contacts, units {reading.units}"
