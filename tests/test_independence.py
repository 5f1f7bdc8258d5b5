"""The two derivations stay independent: who may import whom."""

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FROM_PACKAGE = {"granular_lmp.runs.record", "granular_lmp.crystal.sphere"}


def imports(source: str) -> set[str]:
    """Dotted names a source imports, at any depth; `from a import b` counts as a.b, `from a.b import c` as a.b too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            names |= {module} if "." in module else {f"{module}.{alias.name}" for alias in node.names}
    return names


def roots(source: str) -> set[str]:
    return {name.split(".")[0] for name in imports(source)}


def forbidden_in_analysis(source: str) -> set[str]:
    """Imports of granular_lmp other than record and sphere; relative imports are refused, they hide where they lead."""
    return {name for name in imports(source) if name.split(".")[0] in ("granular_lmp", "")} - FROM_PACKAGE


def sources(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


@pytest.mark.parametrize(
    "line", ["import granular_lmp", "from granular_lmp import modes", "import granular_lmp.lammps.deck", "from . import x"]
)
def test_a_forbidden_import_is_seen(line):
    assert forbidden_in_analysis(f"def f():\n    {line}\n")


@pytest.mark.parametrize(
    "line", ["from granular_lmp import sphere", "from granular_lmp.runs.record import read", "import granular_lmp.crystal.sphere"]
)
def test_record_and_sphere_are_allowed(line):
    assert not forbidden_in_analysis(line)


def test_closed_form_needs_numpy_and_the_standard_library_only():
    allowed = {"numpy"} | set(sys.stdlib_module_names)
    assert roots((ROOT / "analysis/second_harmonic.py").read_text()) <= allowed


def test_lattice_is_built_on_no_part_of_the_package():
    allowed = {"numpy", "scipy", "analysis"} | set(sys.stdlib_module_names)
    assert roots((ROOT / "analysis/lattice.py").read_text()) <= allowed


@pytest.mark.parametrize("path", sources("analysis"), ids=lambda path: path.name)
def test_analysis_imports_record_and_sphere_at_most(path):
    assert not forbidden_in_analysis(path.read_text())


def test_package_never_imports_analysis():
    assert not [path.name for path in sources("granular_lmp") if "analysis" in roots(path.read_text())]


# The direction of the data: a module imports only from the lines above its own.
ORDER = """
errors units sphere wavevector
fields contact shipped outputs
shape
tables
checks
scene
packing collision
modes
rounding
guards
wave rules datafile
effects
grid steplaw
deck plots
particles
record
budget accuracy locate dumps
status
launch workers
tolerance
crystal
sweep doctor collide knobs sheet
tally
cost view
cli
"""


def against_the_flow(name: str, source: str) -> set[str]:
    """Modules of the package that a module imports although they are not to its left."""
    lines = [line.split() for line in ORDER.split("\n")]
    place = {module: index for index, line in enumerate(lines) for module in line}
    used = {used.split(".")[1] for used in imports(source) if used.startswith("granular_lmp.")} - {"__version__"}
    return {module for module in used if place[module] >= place[name]}


def test_an_import_against_the_flow_is_seen() -> None:
    assert against_the_flow("deck", "from granular_lmp.runs.launch import run") == {"launch"}
    assert not against_the_flow("launch", "from granular_lmp.lammps.deck import build")


@pytest.mark.parametrize("path", sources("granular_lmp"), ids=lambda path: path.stem)
def test_a_module_of_the_package_imports_only_from_its_left(path: Path) -> None:
    if path.stem not in ("__init__", "__main__"):
        assert not against_the_flow(path.stem, path.read_text())
