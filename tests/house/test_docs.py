"""The pages say what is there: links, names of tests and functions, commands, and the error table of the theory."""

import csv
import importlib
import os
import re
import shlex
from argparse import ArgumentParser
from collections.abc import Callable, Collection, Sequence
from functools import cache
from math import pi, sqrt
from pathlib import Path

import numpy as np
import pytest

from granular_analysis import second_harmonic as sh
from granular_analysis.cli import DOORS, scripts
from granular_analysis.measure.norms import relative_error
from granular_analysis.theory import choice, hierarchy, lattice, resonance
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave, shifted_second_order
from granular_lmp import Scene
from granular_lmp.cli.parser import parsers
from granular_lmp.errors import SceneError
from granular_lmp.rest.scene import assignment
from granular_lmp.scene.shipped import SHIPPED

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "RELEASING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES += sorted((ROOT / "analysis" / "cases").glob("*/README.md"))
FORMULA_ERRORS = ROOT / "docs" / "formula_errors.csv"
CODE = re.compile(r"^```[^\n]*\n.*?^```[ \t]*$", re.MULTILINE | re.DOTALL)


def on_pages(find: Callable[[str], Collection[str]]) -> dict[str, Collection[str]]:
    """Return what a function finds in the texts of pages, of those where it finds something."""
    found = {page.relative_to(ROOT).as_posix(): find(page.read_text("utf-8")) for page in PAGES}
    return {page: wrong for page, wrong in found.items() if wrong}


# ---------------------------------------------------------------- links and names


@cache
def made_by_make() -> set[Path]:
    return {ROOT / name for name in re.findall(r"figures/[\w.-]+\.png", (ROOT / "Makefile").read_text("utf-8"))}


def broken_links(text: str, folder: Path) -> set[str]:
    """Relative targets of links and images that neither exist nor are a figure of the Makefile."""
    text = CODE.sub("", text)
    targets = re.findall(r"\]\(<?([^)\s>]+)", text)  # [text](target), ![text](target "title")
    targets += re.findall(r"^ {0,3}\[[^\]]+\]: *<?([^\s>]+)", text, re.MULTILINE)  # [label]: target
    targets += re.findall(r"""<(?:img|a)\b[^>]*?\b(?:src|href)=["']([^"']+)""", text)
    local = {target for target in targets if not re.match(r"[a-z][a-z0-9+.-]*:|#|//", target, re.IGNORECASE)}

    def reached(target: str) -> bool:
        path = Path(os.path.normpath(folder / target.partition("#")[0]))
        return path.exists() or path in made_by_make()

    return {target for target in local if not reached(target)}


@cache
def defined_tests() -> set[str]:
    files = (ROOT / "tests").rglob("test_*.py")
    return set(re.findall(r"^ *def (test_\w+)\(", "\n".join(file.read_text("utf-8") for file in files), re.MULTILINE))


def missing_tests(text: str) -> set[str]:
    """Names of tests in backticks that no file under tests/ defines."""
    return set(re.findall(r"`(test_\w+)(?:\[[^`]*\])?`", text)) - defined_tests()


def missing_names(text: str) -> set[str]:
    """Dotted names in backticks, of either package or of cases, that cannot be imported."""

    def found(dotted: str) -> bool:
        package, *rest = dotted.split(".")
        here = importlib.import_module(package)
        for name in rest:
            if not hasattr(here, name):
                try:
                    importlib.import_module(f"{here.__name__}.{name}")
                except ModuleNotFoundError:
                    return False
            here = getattr(here, name)
        return True

    names = set(re.findall(r"`((?:granular_analysis|granular_lmp|cases)(?:\.\w+)+)(?:\([^`]*\))?`", text))
    return {name for name in names if not found(name)}


def test_every_relative_link_leads_somewhere() -> None:
    found = {page: broken_links(page.read_text("utf-8"), page.parent) for page in PAGES}
    assert {page: links for page, links in found.items() if links} == {}


def test_every_test_named_on_a_page_exists() -> None:
    assert on_pages(missing_tests) == {}


def test_every_function_named_on_a_page_exists() -> None:
    assert on_pages(missing_names) == {}


def test_a_link_to_nowhere_is_found() -> None:
    page = (
        "[a](gone.md#part) ![b](../figures/none.png) [c](../README.md) ![d](../figures/figure2.png) [e](#here)\n"
        '[f](https://example.org/x.md)\n[g]: lost.md\n<img src="away.png">\n```\n[h](in_code.md)\n```\n'
    )
    assert broken_links(page, ROOT / "docs") == {"gone.md#part", "../figures/none.png", "lost.md", "away.png"}


def test_a_name_of_nothing_is_found() -> None:
    assert missing_tests("`test_a_name_of_nothing_is_found`, `test_of_nothing[x]`") == {"test_of_nothing"}
    page = (
        "`granular_analysis.cli`, `granular_analysis.theory.lattice.torus(mode)`, `granular_analysis.latice`, "
        "`granular_analysis.theory.lattice.tori`"
    )
    assert missing_names(page) == {"granular_analysis.latice", "granular_analysis.theory.lattice.tori"}
    assert len(on_pages(str.split)) == len(PAGES) > 50


# ---------------------------------------------------------------- prose

LONGEST = 120
EQUATION = re.compile(r"\$\$.*?\$\$", re.DOTALL)
# Guards do not wake and waves are not heard; a setting is called a setting
AVOIDED = re.compile(r"\b(heard|wakes?|loud|knobs?)\b", re.IGNORECASE)


def prose(text: str) -> str:
    """Return a page without code blocks and displayed equations."""
    for kind in (CODE, EQUATION):
        text = kind.sub("", text)
    return text


def long_lines(text: str) -> list[str]:
    """Return the lines that are longer than a page's source may be; tables, headings and pictures cannot be wrapped."""
    return [line for line in prose(text).splitlines() if len(line) > LONGEST and not re.match(r" *\||#|!\[", line)]


def long_captions(text: str) -> list[str]:
    """Return the captions, paragraphs in italics below a picture, of more than three sentences."""
    captions = re.findall(r"^!\[.*\n\n(\*[^*\s].*?)\n\n", text + "\n\n", re.MULTILINE | re.DOTALL)
    return [caption for caption in captions if len(re.findall(r"\.(?=\s+[A-Z]|\*?$)", caption)) > 3]


def avoided_words(text: str) -> set[str]:
    """Return words of the prose that the pages avoid; names in backticks may hold them."""
    return {word.lower() for word in AVOIDED.findall(re.sub(r"`[^`]*`", "", prose(text)))}


def named_in_prose(text: str) -> list[str]:
    """Return the lines outside of tables that name a test."""
    return [line for line in prose(text).splitlines() if "`test_" in line and not line.lstrip().startswith("|")]


def test_a_page_is_written_in_lines_and_captions_that_are_not_too_long() -> None:
    assert on_pages(long_lines) == {}
    assert on_pages(long_captions) == {}


def test_tests_are_named_in_tables_and_avoided_words_in_none() -> None:
    assert on_pages(avoided_words) == {}
    assert on_pages(named_in_prose) == {}


def uneven_rows(text: str) -> list[str]:
    """Rows of tables that have not as many cells as the line of dashes above them."""
    found, width = [], 0
    for line in CODE.sub("", text).splitlines():
        cells = len(re.split(r"(?<!\\)\|", line)) - 2 if line.startswith("|") else 0
        if re.fullmatch(r"\|[-:| ]+\|", line):
            width = cells
        elif not cells:
            width = 0
        elif width and cells != width:
            found.append(line)
    return found


def test_each_row_of_a_table_has_the_cells_of_its_head() -> None:
    assert on_pages(uneven_rows) == {}


def test_a_row_with_a_cell_too_many_is_found() -> None:
    assert uneven_rows("| a | b |\n|---|---|\n| \\|v\\| | 2 |\n| |v| | 2 |\n\n| x |\n") == ["| |v| | 2 |"]


def test_prose_that_is_not_as_it_should_be_is_found() -> None:
    long = "x" * (LONGEST + 1)
    page = f"# {long}\n\n| {long} |\n\n{long}\n\n$$\n{long}\n$$\n\n```text\n{long}\n```\n"
    assert long_lines(page) == [long]
    assert long_captions("![a](b.png)\n\n*One. Two. Three.*\n") == []
    assert len(long_captions("![a](b.png)\n\n*One. Two\n2.5. Three. Four.*\n")) == 1
    assert avoided_words("Waves are heard in `dump.particles`, and a knob wakes.") == {"heard", "knob", "wakes"}
    assert named_in_prose("See `test_a`.\n\n| a | `test_b` |\n") == ["See `test_a`."]


# ---------------------------------------------------------------- commands

TARGETS = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
SHARED = (ROOT / "analysis/granular_analysis/plotting.py").read_text("utf-8")


def commands(page: str) -> list[list[str]]:
    """Return the commands of a page that are ours, in words: after a dollar, up to a redirection or a second one."""
    page = re.sub(r"\\\n\s*", "", page)  # a backslash continues a command in the next line
    lines = re.findall(rf"^ *\$ ((?:{'|'.join(JUDGES)}) (?:'[^']*'|[^>|(&'\n])+)", page, re.MULTILINE)
    return [shlex.split(line, comments=True) for line in lines]


@cache
def parser() -> ArgumentParser:
    """Return the parser of the commands."""
    return parsers()[0]


def judge_package(words: list[str]) -> None:
    """Refuse a command that the parser refuses, and a shipped scene with a key or value that is not allowed."""
    options = parser().parse_args(words)
    if (SHIPPED / str(getattr(options, "scene", "")) / "scene.toml").is_file():
        Scene.load(options.scene).with_values(dict(map(assignment, options.changes)))


KNOWN = cache(scripts)  # which reads the files of all cases


def judge_analysis(words: list[str]) -> None:
    """Refuse a script that is not there, and an option whose name is neither in the script nor in what all share."""
    script, *rest = ["case", "--list", *words[1:]] if words[0] == "cases" else words
    assert script in KNOWN(), script
    file = f"granular_analysis/tools/{script}.py" if script in DOORS else f"cases/{script}/case.py"
    file = "cases/run.py" if script == "case" else file
    text = (ROOT / "analysis" / file).read_text("utf-8") + SHARED
    assert [word for word in rest if word.startswith("-") and f'"{word}"' not in text] == []


def judge_python(words: list[str]) -> None:
    """Refuse a module of `granular_analysis` that is no script."""
    if words[0] == "-m" and words[1].startswith("granular_analysis."):
        judge_analysis([words[1].split(".")[-1], *words[2:]])


def judge_make(words: list[str]) -> None:
    """Refuse a target that is not in the Makefile."""
    assert {word for word in words if "=" not in word} <= {
        *TARGETS,
        ".venv/ready",
        "&&",
        "source",
        ".venv/bin/activate",
    }


JUDGES = {
    "granular-lmp": judge_package,
    "granular-analysis": judge_analysis,
    "python": judge_python,
    "make": judge_make,
}


def refused_commands(text: str) -> dict[str, str]:
    """Return the commands of a page that a judge refuses, with the reason."""
    refused = {}
    for command in commands(text):
        try:
            JUDGES[command[0]](command[1:])
        except (SystemExit, SceneError, AssertionError) as error:
            refused[" ".join(command)] = repr(error)
    return refused


def test_every_figure_is_on_a_page() -> None:
    shown = {name for page in PAGES for name in re.findall(r"/figures/([\w./-]+)", page.read_text("utf-8"))}
    shown |= set(re.findall(r"\(figures/([\w./-]+)", (ROOT / "README.md").read_text("utf-8")))
    there = {each.relative_to(ROOT / "figures").as_posix() for each in (ROOT / "figures").rglob("*.*")}
    assert there - shown == set()


@pytest.mark.parametrize("page", ["README.md", "docs/index.md", "docs/tutorial.md"])
def test_a_first_page_begins_with_the_installation(page: str) -> None:
    first = re.search(r"(?:\$ |`)((?:pip|make|python|granular-\w+) [^`#\n]*)", (ROOT / page).read_text("utf-8"))
    assert first is not None
    assert first[1].strip() == "pip install ."


@pytest.mark.parametrize("page", ["README.md", "docs/index.md", "docs/tutorial.md", "the help"])
def test_the_first_command_is_one_everywhere(page: str) -> None:
    text = parser().format_help() if page == "the help" else (ROOT / page).read_text("utf-8")
    first = re.search(r"granular-lmp (?:run|list|init|check|sweep) [^#.`]*[^#.`\s]", text)
    assert first is not None
    assert " ".join(first[0].split()) == "granular-lmp run tr_resonant -o runs/first"


def test_the_ten_lines_of_the_readme_are_the_scene_of_the_first_command(tmp_path: Path) -> None:
    block = re.search(r"```toml[^\n]*\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
    assert block is not None
    assert len(re.findall(r"^\w+ =", block[1], re.MULTILINE)) <= 10
    (tmp_path / "first.toml").write_text(block[1], encoding="utf-8")
    own, shipped = (Scene.load(each).to_dict() for each in (tmp_path / "first.toml", "tr_resonant"))
    differ = {table for table in own if own[table] != shipped[table]}
    assert differ == {"name", "description", "packing"}  # whose rows are as many as the duration needs, or 201


def test_every_command_of_a_page_is_one_that_the_programs_take() -> None:
    assert on_pages(refused_commands) == {}


@pytest.mark.parametrize(
    "command",
    [
        "granular-lmp rum tr_periodic",
        "granular-lmp run tr_periodic --folder here",
        "granular-lmp run tr_periodic --set wave.amplitude=-1",
        "granular-lmp check tr_periodic --set wave.colour=1 > file",
        "granular-analysis specturm sweeps",
        "granular-analysis spectrum sweeps --svc points.csv",
        "granular-analysis mapp",
        "make paperr  # a target",
    ],
)
def test_a_command_that_is_wrong_is_found(command: str) -> None:
    assert len(refused_commands(f"```console\n$ {command}\n$ ls\n```\n")) == 1


# ---------------------------------------------------------------- numbers of the theory

NU, AMPLITUDE = 0.17, 0.2
TAU = np.linspace(0, 120, 241)
SILICA = sh.ratios(NU)
FORMULAS = {
    "second order": choice.second_order,
    "with frequency shift": shifted_second_order,
    "two waves": resonance.two_mode,
    "three waves": resonance.three_mode,
}
WAVES = ["TR 0.802", "TR 1.475", "TR 2.127", "RT 0.802", "L 0.802"]


def error_table(text: str) -> dict[tuple[str, str], str]:
    """Return the cells of the table of errors by formula and wave."""
    return {(row["formula"], wave): row[wave] for row in csv.DictReader(text.splitlines()) for wave in WAVES}


@cache
def measured_errors(label: str) -> dict[str, list[float] | None]:
    """Relative errors of p, q, φ (L: of p) by formula; None where a formula refuses the wave."""
    name, xi = label.split()
    mode = sh.mode(name, float(xi), SILICA)
    moving = slice(1 if name == "L" else 3)
    exact = lattice.torus(Wave(mode, AMPLITUDE, Contact(NU)), TAU, rtol=1e-10)[moving]

    def errors(estimate: Sequence[np.ndarray]) -> list[float]:
        return [relative_error(e, x) for e, x in zip(estimate[moving], exact, strict=True)]

    found: dict[str, list[float] | None] = {}
    for formula, function in FORMULAS.items():
        try:
            estimate = function(Wave(mode, AMPLITUDE, Contact(NU)), TAU)
        except ValueError:
            found[formula] = None
        else:
            found[formula] = errors(estimate)
    orders = hierarchy.hierarchy_orders(mode, Contact(NU), TAU) @ lattice.periodic_kernel(-lattice.torus_phases(13), 13)
    for n in (4, 6):
        found[f"hierarchy, order {n}"] = errors(np.tensordot(AMPLITUDE ** np.arange(n), orders[:n], axes=1).T)
    return found


def agrees(cell: str, errors: list[float] | None) -> bool:
    """Return whether a cell shows the errors, rounded to its two digits; "≤ x" is a bound, "–" a wave refused."""
    if errors is None or cell == "–":
        return errors is None and cell == "–"
    entries = cell.split(", ")
    return len(entries) == len(errors) and all(
        error <= float(entry[1:]) if entry.startswith("≤") else abs(error - float(entry)) <= half_unit(entry)
        for entry, error in zip(entries, errors, strict=True)
    )


def half_unit(entry: str) -> float:
    """Half a unit of the second digit, and 2 % of that for the integration's own error."""
    return 0.51 * 10.0 ** (np.floor(np.log10(float(entry))) - 1)


@pytest.mark.parametrize("wave", WAVES)
def test_errors_of_the_formulas_on_their_page_are_measured(wave: str) -> None:
    table = error_table(FORMULA_ERRORS.read_text("utf-8"))
    shown = {formula: cell for (formula, label), cell in table.items() if label == wave}
    assert shown.keys() == measured_errors(wave).keys()
    assert [formula for formula, cell in shown.items() if not agrees(cell, measured_errors(wave)[formula])] == []


@pytest.mark.parametrize("wrong", ["4.1e-3, 2.4e-3", "4.2e-3", "4.2e-3, ≤ 1e-3", "–"])
def test_a_wrong_number_in_the_error_table_is_found(wrong: str) -> None:
    assert agrees("4.2e-3, ≤ 1e-2", [4.17e-3, 2.41e-3])
    assert not agrees(wrong, [4.17e-3, 2.41e-3])


@pytest.mark.parametrize("nu", [-1.0, -0.5, 0.0, 0.17, 0.5])
def test_solid_spheres_have_the_polynomials_of_the_theory_page(nu: float) -> None:
    constants = sh.ratios(nu)
    kappa, c = constants.kappa, np.cos(sh.resonance(constants))
    cubic = (20 * kappa * (2 + c) - (kappa + 3) * (1 - c**2)) * (5 * kappa - 1 - (kappa + 3) * c)
    # Rounding of terms of order 100.
    assert cubic == pytest.approx(120 * kappa**2 * (1 + c), rel=0, abs=1e-11)
    expected = (8 * kappa**2 - 10 * kappa + 1) / (2 * kappa + 1)
    assert np.cos(sh.antiresonance(constants)) == pytest.approx(expected, rel=0, abs=1e-14)


# ---------------------------------------------------------------- the glossary


def test_numbers_of_the_glossary_are_those_of_the_paper_s_spheres() -> None:
    sphere = Scene.load("tr_nonresonant").sphere
    rows = sphere.lattice_constant * sqrt(3) / 2
    page = (ROOT / "docs" / "glossary.md").read_text("utf-8")
    for said in (
        f"| {sphere.radius * 1e6} µm, {sphere.mass:.3e} kg |",
        f"| {sphere.static_overlap * 1e9:.4f} nm |",
        f"| {sphere.normal_stiffness:.1f} N/m, {sphere.shear_stiffness:.1f} N/m |",
        f"| {sphere.time_scale * 1e9:.3f} ns |",
        f"| ξ = 1: {2 * pi * rows * 1e6:.2f} µm |",
        f"| ω = 1: {1e-6 / (2 * pi * sphere.time_scale):.1f} MHz |",
        f"| {sphere.overlap_ratio:.1e} |".replace("e-04", "e-4"),
    ):
        assert said in page
