"""The two derivations stay independent: who may import whom."""

import ast
import re
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = {"granular_lmp": ROOT / "granular_lmp", "granular_analysis": ROOT / "analysis/granular_analysis"}
# How both programs begin, end, are stopped, lock a folder and read --set, -o and --over, which is no physics
COMMANDS = {
    "granular_lmp.cli.entry",
    "granular_lmp.cli.arguments.changes_argument",
    "granular_lmp.cli.arguments.changes_of",
    "granular_lmp.cli.arguments.folder_arguments",
    "granular_lmp.cli.arguments.positive",
    "granular_lmp.cli.output.interruptible",
    "granular_lmp.cli.output.notes_of_log",
    "granular_lmp.cli.run_commands.say_how_it_went",
    "granular_lmp.cli.study_commands.sweep_arguments",
    "granular_lmp.cli.study_commands.sweep_of",
    "granular_lmp.runs.folder.locked",
}
# The network in place of LAMMPS's loop: what an engine is given and gives, and the run that takes it. What is given are
# the spheres of the data file and the scene, as in the first snapshot of a record
ENGINE = {"granular_lmp.runs.engine", "granular_lmp.accuracy.tolerance"}
# Of records, of unnamed crystals and of tables
READERS = {"granular_lmp.runs.record", "granular_lmp.runs.unnamed", "granular_lmp.scene.spreadsheets"}
FROM_PACKAGE = {*READERS, *COMMANDS, *ENGINE, "granular_lmp.crystal.sphere", "granular_lmp.compiled"}


# Only these statements are parsed: all sources take four seconds
IMPORT = re.compile(r"^[ \t]*((?:from[ \t]+[\w.]+[ \t]+)?import[ \t](?:[^\n(]*\([^)]*\)|[^\n]*))", re.MULTILINE)


@cache
def imports(source: str) -> frozenset[str]:
    """Return the dotted names that a source imports, at any depth; `from a.b import c` counts as a.b.c."""
    names: set[str] = set()
    for node in ast.parse("\n".join(IMPORT.findall(source))).body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            names |= {f"{module}.{alias.name}" for alias in node.names}
    return frozenset(names)


def roots(source: str) -> set[str]:
    return {name.split(".")[0] for name in imports(source)}


def forbidden_in_analysis(source: str) -> set[str]:
    """Imports of granular_lmp other than these; relative imports are refused, they hide where they lead."""
    names = {name for name in imports(source) if name.split(".")[0] in ("granular_lmp", "")}
    return {name for name in names if not {name, name.rpartition(".")[0]} & FROM_PACKAGE}


def sources(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.py"))


@pytest.mark.parametrize(
    "line",
    ["import granular_lmp", "from granular_lmp import crystal", "import granular_lmp.lammps.deck", "from . import x"],
)
def test_a_forbidden_import_is_seen(line):
    assert forbidden_in_analysis(f"def f():\n    {line}\n")


@pytest.mark.parametrize(
    "line",
    [
        "from granular_lmp.crystal.sphere import Sphere",
        "from granular_lmp.runs.record import read",
        "import granular_lmp.crystal.sphere",
    ],
)
def test_record_and_sphere_are_allowed(line):
    assert not forbidden_in_analysis(line)


def test_closed_form_needs_numpy_and_the_standard_library_only():
    allowed = {"numpy"} | set(sys.stdlib_module_names)
    assert roots((ROOT / "analysis/granular_analysis/second_harmonic.py").read_text()) <= allowed


def test_lattice_is_built_on_no_part_of_the_package():
    allowed = {"numpy", "scipy", "granular_analysis"} | set(sys.stdlib_module_names)
    assert roots((ROOT / "analysis/granular_analysis/theory/lattice.py").read_text()) <= allowed


def of_analysis(find: Callable[[str], set[str]]) -> dict[Path, set[str]]:
    """Return what a function finds in the sources of analysis, of those where it finds something."""
    found = {path: find(path.read_text()) for path in sources(ROOT / "analysis")}
    return {path: wrong for path, wrong in found.items() if wrong}


def test_analysis_imports_record_and_sphere_at_most():
    """*quiet* shows what the package expects of the layers that it chooses; *own_deck* runs and adopts a deck."""
    assert {path.parent.name for path in of_analysis(forbidden_in_analysis)} == {"quiet", "own_deck"}


def test_only_the_network_runs_in_place_of_lammps() -> None:
    found = of_analysis(lambda source: {each.rpartition(".")[0] for each in imports(source)} & ENGINE)
    library = {path: used for path, used in found.items() if "granular_analysis" in path.parts}
    assert {(path.parent.name, path.name): used for path, used in library.items()} == {
        ("measure", "stepping.py"): {"granular_lmp.runs.engine"},
        ("tools", "network.py"): {"granular_lmp.accuracy.tolerance"},
    }


def decks_named(source: str) -> set[str]:
    """Return the strings of a source that name a deck, ``in.NAME``."""
    return set(re.findall(r"""["'](?:[^"'\s]*/)?in\.[\w*{]""", source))


def test_analysis_reads_no_deck() -> None:
    """What a run is, its scene, data, dumps and run.json say."""
    assert not of_analysis(decks_named)
    assert all(decks_named(each) for each in ('glob("in.*")', "f'{a}/in.{b}'", 'f"in.{name}"'))
    assert not decks_named('"""Holds in.NAME."""')


PREPARED = ("problem", "rest", "energies", "energy", "kinetic_energy")  # of a record: what the package makes of a scene


def asked_of_records(source: str) -> set[str]:
    """Return the attributes named like a record's own physics that a source asks of anything named like a record.

    The problem is one of a record, however that is named.
    """
    if not re.search(rf"\.({'|'.join(PREPARED)})\b", source):  # most sources, which need not be parsed
        return set()
    return {
        node.attr
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Attribute)
        and node.attr in PREPARED
        and (node.attr == "problem" or ast.unparse(node.value).endswith("record"))
    }


def test_analysis_asks_a_record_for_nothing_that_the_package_computes() -> None:
    assert of_analysis(asked_of_records) == {}


def test_what_is_asked_of_a_record_is_seen() -> None:
    assert asked_of_records("def f(run):\n    return run.problem.mass, record.rest") == {"problem", "rest"}
    assert not asked_of_records("scene.rest, record.displacement, self.record.velocity")


def test_all_sources_of_analysis_are_read() -> None:
    assert len(of_analysis(lambda source: {source[:1]})) > 100


def test_package_never_imports_analysis_and_analysis_no_case():
    for package, others in (("granular_lmp", {"granular_analysis", "cases"}), ("granular_analysis", {"cases"})):
        assert not [path.name for path in sources(FOLDERS[package]) if others & roots(path.read_text())]


# --- rooms of the package ---------------------------------------------------------------------------------------------

# The direction of the data: a room (a folder, or a module beside the folders) and the rooms that it may import. A room
# stands below all that it may import, so that there is no circle between rooms.
MAY_IMPORT: dict[str, set[str]] = {
    "version": set(),
    "errors": set(),
    "frozen": set(),
    "card": set(),
    "units": {"frozen"},
    "progress": set(),
    "compiled": {"errors"},
    "crystal": {"errors", "frozen"},
    "scene": {"errors", "frozen", "units", "crystal"},
    "rest": {"errors", "frozen", "card", "units", "crystal", "scene"},
    "effects": {"errors", "frozen", "units", "crystal", "scene", "rest"},
    "problem": {"errors", "frozen", "units", "crystal", "scene", "rest", "effects"},
    "lammps": {"errors", "frozen", "compiled", "card", "units", "crystal", "scene", "rest", "effects", "problem"},
    "runs": {
        "version",
        "errors",
        "frozen",
        "card",
        "units",
        "crystal",
        "scene",
        "rest",
        "effects",
        "problem",
        "lammps",
    },
    "accuracy": {"errors", "frozen", "units", "crystal", "scene", "rest", "effects", "problem", "lammps", "runs"},
    "studies": {"errors", "frozen", "card", "units", "crystal", "scene", "rest", "effects", "problem", "lammps"}
    | {"runs", "accuracy"},
    "plot": {"errors", "frozen", "problem", "crystal", "scene", "rest", "lammps", "runs", "accuracy", "studies"},
    "foreign": {"version", "errors", "frozen", "units", "crystal", "scene", "rest", "problem", "lammps", "runs"},
    "doctor": {"version", "errors", "frozen", "scene", "rest", "problem", "lammps", "runs", "accuracy", "studies"},
}
MAY_IMPORT["cli"] = set(MAY_IMPORT)


# The rooms of analysis: the closed form is read first and knows none of them; the tools are the door to all.
ANALYSIS_MAY_IMPORT: dict[str, set[str]] = {
    "second_harmonic": set(),
    "theory": {"second_harmonic"},
    "measure": {"second_harmonic", "theory"},
    "plotting": {"theory"},
    "tools": {"second_harmonic", "theory", "measure", "plotting"},
    "cli": {"plotting", "tools"},
}


def package_graph(texts: dict[str, str], package: str = "granular_lmp") -> dict[str, set[str]]:
    """Return, for each module of a package (dotted, without its name), the modules that it imports."""
    graph = {}
    for module, text in texts.items():
        names = {name.removeprefix(f"{package}.") for name in imports(text) if name.startswith(f"{package}.")}
        names |= {name.rpartition(".")[0] for name in names}  # `from granular_lmp.a.b import c` names a.b or a.b.c
        graph[module] = names & texts.keys()
    return graph


def arrows(graph: dict[str, set[str]]) -> set[tuple[str, str]]:
    """Return the pairs of different rooms (importing, imported)."""
    pairs = {(module.split(".")[0], used.split(".")[0]) for module, all_used in graph.items() for used in all_used}
    return {(importing, imported) for importing, imported in pairs if importing != imported}


def circle(graph: dict[str, set[str]]) -> set[str]:
    """Return the nodes that lie on a circle, or lead to one; empty where there is none."""
    left = dict(graph)
    while leaves := {node for node, used in left.items() if not used & left.keys()}:
        left = {node: used for node, used in left.items() if node not in leaves}
    return set(left)


def of_package(package: str) -> dict[str, str]:
    """Return the source of each module of a package but ``__init__`` and ``__main__``."""
    root = FOLDERS[package]
    return {
        ".".join(path.relative_to(root).with_suffix("").parts): path.read_text()
        for path in sources(root)
        if path.stem not in ("__init__", "__main__")
    }


TABLES = {"granular_lmp": MAY_IMPORT, "granular_analysis": ANALYSIS_MAY_IMPORT}


@cache
def graph_of(package: str) -> dict[str, set[str]]:
    """Return the graph of a package."""
    return package_graph(of_package(package), package)


@pytest.mark.parametrize("package", FOLDERS)
def test_every_room_has_its_line_in_the_table(package: str) -> None:
    assert {module.split(".")[0] for module in graph_of(package)} == set(TABLES[package])


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_a_room_imports_only_what_stands_above_it_in_the_table(table: dict[str, set[str]]) -> None:
    for place, (room, allowed) in enumerate(table.items()):
        assert allowed <= set(list(table)[:place]), room


@pytest.mark.parametrize("package", FOLDERS)
def test_no_room_imports_another_than_it_may(package: str) -> None:
    beyond = {(room, used) for room, used in arrows(graph_of(package)) if used not in TABLES[package][room]}
    assert not beyond, {pair: importers(package, *pair) for pair in beyond}


def importers(package: str, room: str, used: str) -> list[str]:
    """Return the modules of a room that import another room."""
    return sorted(module for module, names in graph_of(package).items() if (room, used) in arrows({module: names}))


@pytest.mark.parametrize("package", FOLDERS)
def test_no_circle_between_modules_also_not_through_imports_inside_functions(package: str) -> None:
    assert not circle(graph_of(package))
    offered = {name for text in of_package(package).values() for name in imports(text) if name.startswith(package)}
    # What the package itself offers it takes from its modules, so that these import each other and not it
    assert {name.split(".")[1] for name in offered} <= TABLES[package].keys()


@pytest.mark.parametrize(
    "line",
    [
        "from granular_lmp.runs.launch import run",
        "from granular_lmp.runs import launch",
        "import granular_lmp.runs.launch",
        "def f():\n    from granular_lmp.runs.launch import run",
    ],
)
def test_an_arrow_between_rooms_is_seen_however_it_is_written(line: str) -> None:
    graph = package_graph({"lammps.deck": line, "runs.launch": "", "runs.record": ""})
    assert graph["lammps.deck"] == {"runs.launch"}
    assert arrows(graph) == {("lammps", "runs")}


def test_a_circle_is_seen() -> None:
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}) == {"a", "b", "c"}
    assert not circle({"a": {"b"}, "b": {"c"}, "c": set()})


@pytest.mark.parametrize("name", ["bonds", "crystal", "second_order", "third_order", "phase_matching", "validity"])
def test_the_theory_of_any_crystal_knows_neither_the_closed_form_nor_the_package(name: str) -> None:
    found, left = set(), {f"theory.{name}"}
    while left:
        found |= left
        left = set().union(*(graph_of("granular_analysis")[each] for each in left)) - found
    assert "second_harmonic" not in found
    texts = of_package("granular_analysis")
    assert not any("granular_lmp" in roots(texts[each]) for each in found)


# --- what comes after `prepare` ---------------------------------------------------------------------------------------

# Parameters that are a Scene in the rooms behind `prepare`, at most: of entries that prepare it, of what makes other
# scenes of it, as a sweep does, and of what reads a folder, which is not prepared again
SCENES_AFTER_PREPARE = {"accuracy": 11, "cli": 12, "lammps": 1, "plot": 19, "runs": 23, "studies": 22}


def scenes_taken(source: str) -> int:
    """Return how many parameters of functions are annotated as a Scene, alone or in another type."""
    if not re.search(r":[^=\n]*\bScene\b", source):  # most sources, which need not be parsed
        return 0
    functions = [each for each in ast.walk(ast.parse(source)) if isinstance(each, ast.FunctionDef)]
    arguments = [arg for each in functions for arg in (*each.args.posonlyargs, *each.args.args, *each.args.kwonlyargs)]
    return sum(bool(re.search(r"\bScene\b", ast.unparse(arg.annotation))) for arg in arguments if arg.annotation)


@pytest.mark.parametrize("room", SCENES_AFTER_PREPARE)
def test_what_comes_after_prepare_takes_the_problem(room: str) -> None:
    """A number here may only fall: a function that is called with a prepared scene takes the Problem."""
    taken = {str(path): scenes_taken(path.read_text()) for path in sources(ROOT / "granular_lmp" / room)}
    assert sum(taken.values()) <= SCENES_AFTER_PREPARE[room], {path: n for path, n in taken.items() if n}


def test_a_scene_that_a_function_takes_is_seen() -> None:
    assert scenes_taken("def f(a: Scene, *, b: 'Sequence[Scene]', c: Scene | None = None): pass") == 3
    assert scenes_taken("def f(a: Problem, b: ImpactScene, c) -> Scene: pass") == 0


# --- rooms of the tests -----------------------------------------------------------------------------------------------

# Beside the rooms of both packages: what compares and designs, what LAMMPS does beside theory, what stands in no room
OTHER_ROOMS = {"cases", "compare", "validation", "hard", "matrix", "promises", "house", "engines", "manual"}


def test_every_test_stands_in_a_room_of_what_it_tests() -> None:
    rooms = {path.parent for path in (ROOT / "tests").rglob("test_*.py")}
    assert {room.parent for room in rooms} == {ROOT / "tests"}
    assert {room.name for room in rooms} <= {*MAY_IMPORT, *ANALYSIS_MAY_IMPORT, *OTHER_ROOMS}
