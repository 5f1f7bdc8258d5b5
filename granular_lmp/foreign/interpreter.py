"""Let LAMMPS execute a deck of any origin command by command, without its output and without its long runs.

LAMMPS resolves variables, formulas and files. This module executes the commands that steer the order of others
(``include``, ``jump``, ``label``, ``next``, ``if``), so that each command is known with its file, its line and its
resolved words. Commands that write files are noted, not executed; a fix writes into the working directory of the
process. Commands that run other programs are refused, and so are unknown commands. For a run of more than one step only
the forces of its first step are computed.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from granular_lmp.errors import DeckError
from granular_lmp.frozen import dataclass

MOST_COMMANDS = 100_000  # stops an endless loop after a second or two
_WORD = re.compile(r'"""(.*?)"""|"([^"]*)"|\'([^\']*)\'|(\S+)', re.DOTALL)
_RUN = re.compile(
    r"run [-+]?\d+( upto| (start|stop) \S+| (pre|post) (yes|no|on|off|true|false))*( every .*)?", re.DOTALL
)
_EXPANDED = re.compile(r"\$\{(\w+)\}|\$(\w)|\$\(([^)]*(?:\([^)]*\)[^)]*)*)\)")
# Words of a formula whose values runs change: computes, fixes, groups, spheres, and keywords of thermo
_BY_RUNS = re.compile(
    r"\b([cfC]_\w+|(?:xcm|vcm|fcm|bound|gyration|ke|angmom|torque|inertia|omega)\s*\(|(?:f|v|omega)?[xyz]\s*\["
    r"|step|elapsed|elaplong|time|cpu|atoms|temp|press|pe|ke|etotal|evdwl|epair|enthalpy|vol|density"
    r"|l[xyz]|[xyz](?:lo|hi)|p[xyz][xyz]|fmax|fnorm)(?!\w)"
)
_NOTED = ("pair_style", "pair_coeff", "labelmap", "neigh_modify", "read_restart", "clear")
FEWEST = {"fix": 4, "dump": 6}  # words of a command that is whole
_FORMULAS = ("equal", "atom", "vector")
_COMMENT = re.compile(r'(""".*?"""|"[^"]*"|\'[^\']*\')|#.*', re.DOTALL)
_WRITING = (
    *("print", "log", "echo", "info", "restart", "timer", "dump", "dump_modify", "undump", "rerun"),
    *("write_coeff", "write_data", "write_dump", "write_restart", "balance", "group2ndx"),
)
_RUNNING_PROGRAMS = ("shell", "python", "plugin", "mdi", "message", "server", "geturl", "kim", "partition")
_EXECUTED = {
    *("atom_modify", "atom_style", "boundary", "box", "change_box", "clear", "comm_modify", "comm_style", "compute"),
    *("compute_modify", "create_atoms", "create_box", "delete_atoms", "dimension", "displace_atoms", "fix"),
    *("fix_modify", "group", "labelmap", "lattice", "mass", "min_modify", "min_style", "molecule"),
    *("neigh_modify", "neighbor", "newton", "package", "pair_coeff", "pair_modify", "pair_style", "processors"),
    *("read_data", "read_dump", "read_restart", "region", "replicate", "reset_atoms", "reset_timestep"),
    *("bond_coeff", "bond_style", "create_bonds", "delete_bonds", "run_style", "set", "special_bonds", "suffix"),
    *("thermo", "thermo_modify", "thermo_style", "timestep"),
    *("uncompute", "unfix", "units", "variable", "velocity"),
}
_STYLES_RUNNING_PROGRAMS = ("python", "python/invoke", "python/move", "imd", "ipi", "mdi/qm", "mdi/qmmm", "client/md")
_PLACE_OF_STYLE = {"fix": 3, "variable": 2, "pair_style": 1}
# Commands that read files, and the place of the first word that may name one
_READING = {"read_data": 1, "read_restart": 1, "read_dump": 1, "molecule": 2, "create_atoms": 1}
_READING |= {"pair_coeff": 3, "region": 3, "fix": 4}
_BEFORE_OUTPUT = ("file", "append", "overwrite", "out")


@dataclass(frozen=True)
class Command:
    """A command of a deck, after LAMMPS has resolved its variables.

    Attributes
    ----------
    file : name of its file.
    line : number of its first line.
    words : its words, without quotes.
    unsure : whether LAMMPS would give it other words if it had executed the long runs before.
    """

    file: str
    line: int
    words: tuple[str, ...]
    unsure: bool = False

    @property
    def name(self) -> str:
        """Name of the command."""
        return self.words[0]

    @property
    def place(self) -> str:
        """File and line, as ``in.chain:12``."""
        return f"{self.file}:{self.line}"

    def __str__(self) -> str:
        """Return the command on one line."""
        return " ".join(self.words)


def split(text: str) -> tuple[str, ...]:
    """Return the words of a command without their quotes."""
    return tuple(next((group for group in match.groups() if group is not None), "") for match in _WORD.finditer(text))


def lines_of(text: str) -> list[tuple[int, str]]:
    """Return the commands of a file as written but without comments, each with the number of its first line.

    As in LAMMPS, lines are joined before comments are stripped: a comment that ends in "&" swallows the next line.
    A file that ends within a command leaves the last command with its "&", or with its open quotes.
    """
    found: list[tuple[int, str]] = []
    first, joined = 1, ""
    lines = text.removesuffix("\n").split("\n")
    for number, line in enumerate(lines, start=1):
        joined += line
        if number < len(lines) and joined.rstrip().endswith("&"):
            joined = joined.rstrip()[:-1]
        elif number < len(lines) and joined.count('"""') % 2:
            joined += "\n"
        else:
            if bare := _COMMENT.sub(lambda match: match[1] or "", joined).strip():
                found.append((first, bare))
            first, joined = number + 1, ""
    return found


def switch(on: dict[str, Command], command: Command, kind: str) -> None:
    """Add a command to the fixes or dumps that are on, or take out those that it ends.

    A fix that is given again keeps its place, as in LAMMPS.
    """
    if command.name == kind and len(command.words) >= FEWEST[kind]:
        on[command.words[1]] = command
    elif command.name == f"un{kind}":
        on.pop("".join(command.words[1:2]), None)
    elif command.name == "clear":
        on.clear()


class Interpreter:
    """Executes the commands of a deck in an instance of LAMMPS.

    Parameters
    ----------
    lmp : lammps.lammps
        The instance.
    deck : Path
        The deck; the files that it names are in its folder.
    at_run : callable
        Called in place of a run or a minimization, with the command and its number of steps (None for a minimization);
        it lets LAMMPS compute the forces.
    tell : callable, optional
        Called with each command before it is executed.

    Attributes
    ----------
    commands : the commands so far, in the order of their execution.
    on : the fixes and dumps that are on, by kind and ID, in the order of LAMMPS.
    noted : the commands so far that give laws, exclude pairs or begin anew.
    cleared, reset : numbers of commands at the last ``clear``, and at the last command that set the step.
    """

    def __init__(
        self,
        lmp: Any,
        deck: Path,
        at_run: Callable[[Command, int | None], None],
        tell: Callable[[Command], object] | None = None,
    ):
        self.lmp = lmp
        self.folder = deck.parent
        self.commands: list[Command] = []
        self.on: dict[str, dict[str, Command]] = {"fix": {}, "dump": {}}
        self.noted: list[Command] = []
        self.cleared = self.reset = 0
        self._at_run = at_run
        self._tell = tell or (lambda _: None)
        self._exhausted = False
        self._skipped = False  # whether a run of several steps, or a minimization, came before
        self._by_runs: set[str] = set()  # variables whose values runs change
        self._unfinished: set[tuple[str, int]] = set()  # lines whose "&" ends the file
        self._files: list[tuple[Path, Iterator[tuple[int, str]]]] = []
        self._open(deck)

    def read(self) -> None:
        """Execute the deck to its end, or to ``quit``.

        Raises
        ------
        DeckError
            If the deck runs other programs or loops for ever, or if LAMMPS refuses a command.
        """
        while self._files:
            path, lines = self._files[-1]
            line = next(lines, None)
            if line is None:
                self._files.pop()
                continue
            self._execute(path.name, *line)

    def _open(self, path: Path, label: str | None = None) -> None:
        if path.exists() and not path.is_file():
            raise DeckError(f"{path}: is not a file")
        try:
            text = path.read_text(encoding="utf-8", errors="replace")
        except OSError as error:
            raise DeckError(f"{path}: cannot be read: {error.strerror}") from error
        commands = lines_of(text)
        if commands and text.rstrip().endswith("&"):
            self._unfinished.add((path.name, commands[-1][0]))
        lines = iter(commands)
        if label is not None and not any(split(text)[:2] == ("label", label) for _, text in lines):
            raise DeckError(f"{path.name}: there is no label {label!r} to jump to")
        self._files.append((path, lines))

    def _execute(self, file: str, line: int, text: str) -> None:
        where = f"{file}, line {line}"
        if (file, line) in self._unfinished and text.endswith("&"):
            raise DeckError(f"{where}: the file ends in '&' here, and LAMMPS refuses '{text}'; take out the '&'")
        if len(self.commands) > MOST_COMMANDS:
            raise DeckError(f"{where}: stopped after {MOST_COMMANDS} commands; is this an endless loop?")
        words = split(self._asked(where, text, lambda: self.lmp.expand(text)))
        if not words:
            return
        command = Command(file, line, words, self._unsure(text))
        self._note(command)
        self.commands.append(command)
        self._tell(command)
        style = words[_PLACE_OF_STYLE[words[0]] :] if words[0] in _PLACE_OF_STYLE else ()
        if words[0] != "pair_style":  # a hybrid pair style names several styles
            style = style[:1]
        if words[0] in _RUNNING_PROGRAMS or set(style) & set(_STYLES_RUNNING_PROGRAMS):
            raise DeckError(
                f"{where}: '{command}' may run other programs, which is refused here; remove it from a copy"
            )
        steering = getattr(self, f"_do_{words[0]}", None)
        if steering is not None:
            try:
                self._asked(where, text, lambda: steering(command))
            except IndexError as error:
                raise DeckError(f"{where}: '{command}' lacks a word") from error
        elif words[0] == "minimize" or _RUN.fullmatch(" ".join(words)):
            self._asked(where, text, lambda: self._at_run(command, _steps(words)))
        elif words[0] == "run":  # LAMMPS says what is wrong with it, and executes nothing
            self._asked(where, text, lambda: self.lmp.command(text))
            raise DeckError(f"{where}: '{command}' has keywords that are not known here; remove them from a copy")
        elif words[0] in _EXECUTED:
            self._asked(where, text, lambda: self.lmp.command(self._with_paths(text)))
        elif words[0] not in _WRITING:
            raise DeckError(f"{where}: '{command}' is a command that is not known here; remove it from a copy")

    def _unsure(self, text: str) -> bool:
        """Return whether the values in a line depend on long runs, which are not executed."""
        for match in _EXPANDED.finditer(text) if self._skipped else ():
            name, formula = match[1] or match[2], match[3] or ""
            if name in self._by_runs or self._changes(formula):
                return True
        return False

    def _changes(self, formula: str) -> bool:
        """Return whether runs change the value of a formula."""
        return bool({*re.findall(r"\bv_(\w+)", formula)} & self._by_runs) or _BY_RUNS.search(formula) is not None

    def _note(self, command: Command) -> None:
        """Note what is on, variables whose values runs change, and whether a long run was skipped."""
        words = command.words
        for kind, on in self.on.items():
            switch(on, command, kind)
        if command.name in _NOTED:
            self.noted.append(command)
        if command.name in ("clear", "reset_timestep"):
            self.reset = len(self.commands)
        if command.name == "variable" and len(words) > 3:
            changing = command.unsure or (words[2] in _FORMULAS and self._changes(" ".join(words[3:])))
            (self._by_runs.add if changing else self._by_runs.discard)(words[1])
        elif command.name == "minimize" or (_RUN.fullmatch(str(command)) and int(words[1]) > 1):
            self._skipped = True
        elif command.name == "clear":
            self._skipped, self.cleared = False, len(self.commands)

    def _asked(self, where: str, text: str, ask: Callable[[], Any]) -> Any:
        try:
            return ask()
        except Exception as error:
            if type(error) is not Exception and type(error).__name__ != "MPIAbortException":
                raise
            said = re.sub(r"^ERROR[^:]*: ", "", str(error).strip()).splitlines()[0]
            raise DeckError(f"{where}: LAMMPS refuses '{' '.join(text.split())}': {said}") from error

    def _with_paths(self, text: str) -> str:
        """Return a command that reads files of the deck's folder and writes into the working directory."""
        name, *words = split(text)
        if name not in _READING and not (name == "variable" and words[1:2] in (["file"], ["atomfile"])):
            return text
        pieces: list[str] = []
        for number, match in enumerate(_WORD.finditer(text)):
            bare, written = match[4], match[0]
            word = self.lmp.expand(f"x {bare}")[2:] if bare and "$" in bare else split(written)[0]
            path = self.folder / word
            if name == "fix" and number > 1 and words[number - 2] in _BEFORE_OUTPUT:
                written = f'"{path.name}"'
            elif number < _READING.get(name, 2) or not word:
                pass
            elif path.is_file() or (name == "read_restart" and "*" in word):
                written = f'"{path}"'
            elif name == "fix" and (word.startswith("/") or ".." in Path(word).parts):
                written = f'"{path.name}"'
            pieces.append(written)
        return " ".join(pieces)

    def _do_include(self, command: Command) -> None:
        self._open(self.folder / command.words[1])

    def _do_label(self, _: Command) -> None:
        """Do nothing at a label."""

    def _do_next(self, command: Command) -> None:
        self.lmp.command(str(command))
        self._exhausted = not self.lmp.has_id("variable", command.words[1])

    def _do_jump(self, command: Command) -> None:
        if self._exhausted:
            self._exhausted = False
            return
        name, label = command.words[1], command.words[2:]
        path, _ = self._files.pop()
        self._open(path if name == "SELF" else self.folder / name, *label[:1])

    def _do_quit(self, _: Command) -> None:
        self._files.clear()

    def _do_if(self, command: Command) -> None:
        words = list(command.words)
        while words:
            kind = words.pop(0)
            holds = kind == "else" or self._holds(command, words.pop(0))
            if words[:1] == ["then"]:
                words.pop(0)
            end = next((n for n, word in enumerate(words) if word in ("elif", "else")), len(words))
            if holds:
                for text in words[:end]:
                    self._execute(command.file, command.line, text)
                return
            words = words[end:]

    def _holds(self, command: Command, condition: str) -> bool:
        name = "granular_lmp_holds"
        text = f'if """{condition}""" then "variable {name} index 1"'
        self._asked(f"{command.file}, line {command.line}", str(command), lambda: self.lmp.command(text))
        holds = bool(self.lmp.has_id("variable", name))
        if holds:
            self.lmp.command(f"variable {name} delete")
        return holds


def _steps(words: tuple[str, ...]) -> int | None:
    return int(words[1]) if words[0] == "run" else None
