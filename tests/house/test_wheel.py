"""The package as a user gets it: built, installed into another environment, and used in an empty folder."""

import ast
import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

from granular_analysis.cli import DOORS, help_texts, scripts
from granular_lmp.scene.shipped import SHIPPED
from tests.house.test_independence import FOLDERS
from tests.house.test_python_of_docs import PYTHON, ROOT

# Of the variables of this process, those that would let Python find the checkout
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}

# Hatchling, which else spends half of its time on the last percents of a compression
BUILD = """
import runpy, zlib
made = zlib.compressobj
zlib.compressobj = lambda level, *more: made(1, *more)
runpy.run_module("hatchling", run_name="__main__")
"""


def started(*command: str | Path, cwd: Path) -> str:
    """Return what a command prints; the test fails with its errors if it fails."""
    done = subprocess.run(command, cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def build(source: Path, into: Path, *kinds: str) -> None:
    started(sys.executable, "-c", BUILD, "build", "-d", into, *kinds, cwd=source)


def one(folder: Path, ending: str) -> Path:
    (found,) = folder.glob(f"*{ending}")
    return found


def names(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the wheel and the source distribution of this checkout."""
    folder = tmp_path_factory.mktemp("built")
    build(ROOT, folder)
    return folder


@pytest.fixture(scope="module")
def programs(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of programs of a new environment that has the wheel, and the dependencies of this one."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder)
    python = folder / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python)]
    # A module that no test imports need not be compiled
    started(*pip, "install", "--quiet", "--no-compile", "--no-deps", "--no-index", one(built, ".whl"), cwd=folder)
    packages = Path(sysconfig.get_path("purelib", vars={"base": str(folder)}))
    # Python reads no .pth files in a folder that one of them names: the link to the checkout stays behind
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    return python.parent


def test_the_wheel_holds_both_packages_typed_and_every_shipped_file(built: Path) -> None:
    shipped = {path.relative_to(SHIPPED).as_posix() for path in SHIPPED.rglob("*") if path.is_file()}
    assert {"in.plane_wave", "tr_pulse/data.tr_pulse", "collisions/test5.toml"} <= shipped
    wanted = {f"granular_lmp/lammps_inputs/{name}" for name in shipped}
    wanted |= {
        "granular_lmp/lammps/kernel/contact.cpp",
        "granular_lmp/studies/identity.json",
        "granular_analysis/theory/loops.c",
        "granular_lmp/plot/matplotlibrc",
        "granular_lmp/plot/page.html",
    }
    for package, folder in FOLDERS.items():
        wanted |= {path.relative_to(folder.parent).as_posix() for path in folder.rglob("*.py")}
        wanted.add(f"{package}/py.typed")
    held = {name for name in names(one(built, ".whl")) if ".dist-info/" not in name}
    assert held == wanted


def test_the_source_distribution_gives_the_same_wheel(built: Path, tmp_path: Path) -> None:
    # A third of the files, which no wheel holds
    besides = [f"--exclude={folder}" for folder in ("*/tests", "*/docs", "*/benchmarks")]
    started("tar", "-xzf", one(built, ".tar.gz"), *besides, cwd=tmp_path)
    source = one(tmp_path, "")
    assert (source / "lammps_inputs" / "in.plane_wave").is_file()
    build(source, tmp_path / "again", "-t", "wheel")
    assert names(one(tmp_path / "again", ".whl")) == names(one(built, ".whl"))


def test_an_installed_scene_runs_and_is_compared(programs: Path, tmp_path: Path) -> None:
    short = ["--set", "packing.rows=16", "--set", "time.duration=12"]
    started(programs / "granular-lmp", "run", "tr_periodic", *short, "-o", "run", cwd=tmp_path)
    assert "hierarchy" in started(programs / "granular-analysis", "compare", "run", cwd=tmp_path)
    assert (tmp_path / "run" / "compare.png").is_file()
    assert "in.plane_wave" in started(programs / "granular-lmp", "init", "--all", "lammps_inputs", cwd=tmp_path)


def test_the_installed_analysis_has_its_scripts(programs: Path, tmp_path: Path) -> None:
    assert "granular-analysis compare" in started(programs / "granular-analysis", "compare", "--help", cwd=tmp_path)


def test_cases_are_only_in_a_checkout_and_an_installed_command_says_so(programs: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [programs / "granular-analysis", "case", "figure2"],
        cwd=tmp_path,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert "case: only a checkout of the repository has cases" in done.stderr


def test_the_python_of_the_readme_runs_where_the_wheel_is_installed(programs: Path, tmp_path: Path) -> None:
    for block in PYTHON.findall((ROOT / "README.md").read_text("utf-8")):
        started(programs / "python", "-c", block, cwd=tmp_path)
    where = "import granular_analysis, granular_lmp; print(granular_analysis.__file__, granular_lmp.__file__)"
    files = started(programs / "python", "-c", where, cwd=tmp_path).split()
    assert all(Path(file).is_relative_to(programs.parent) for file in files)


def test_the_reference_has_the_help_of_every_door_of_analysis() -> None:
    texts = help_texts()
    assert set(texts) == {"granular-analysis", *(f"granular-analysis {door}" for door in DOORS)}
    for name, text in texts.items():
        assert text.startswith(f"usage: {name} ")


# Files and folders of the repository, but not the end of an address
NAMED = re.compile(r"(?<![\w/.])(?:(?:docs|tests|benchmarks|analysis|figures|paper|recipe)/[\w./-]*\w|[\w/-]+\.md\b)")


def leading_away(text: str, held: set[str]) -> list[str]:
    """Return the paths that a text of the wheel names and that the wheel lacks."""
    return [path for path in NAMED.findall(text) if not any(name.endswith(f"/{path}") for name in held)]


def strings(source: str) -> str:
    """Return the messages and docstrings of a source, a line each."""
    if not NAMED.search(source):  # most sources, which need not be parsed
        return ""
    nodes = ast.walk(ast.parse(source))
    return "\n".join(node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str))


def test_nothing_in_a_wheel_leads_to_a_file_that_it_lacks(built: Path) -> None:
    with zipfile.ZipFile(one(built, ".whl")) as archive:
        held = set(archive.namelist())
        texts = {name: archive.read(name).decode() for name in held if not name.endswith((".cpp", ".c"))}
    said = {name: strings(text) if name.endswith(".py") else text for name, text in texts.items()}
    found = {name: leading_away(text, held) for name, text in said.items() if not name.endswith("RECORD")}
    assert {name: paths for name, paths in found.items() if paths} == {}
    assert len(found) > 300
    assert any(name.endswith("METADATA") and "granular-lmp run tr_resonant" in text for name, text in said.items())
    source = '"""See docs/a.md."""  # docs/b.md\nraise ValueError(f"{x}: see tests/fit.py, README.md or lost.md")'
    page = strings(source) + " https://example.org/docs/c.md"
    assert leading_away(page, held) == ["docs/a.md", "tests/fit.py", "lost.md"]


def test_every_script_of_analysis_has_its_name_in_the_command() -> None:
    tools = {path.stem for path in (ROOT / "analysis/granular_analysis/tools").glob("*.py")}
    cases = {path.parent.name for path in (ROOT / "analysis/cases").glob("*/case.py")}
    assert set(scripts()) == tools - {"__init__", "curves", "design_runs", "kept"} | cases | {"case"}


def test_every_command_of_the_project_is_installed(programs: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert all((programs / name).is_file() for name in project["scripts"])
