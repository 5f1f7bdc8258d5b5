"""The oldest versions that pyproject.toml allows are those that continuous integration installs."""

import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.version import Version

ROOT = Path(__file__).parents[2]
JUDGES = {"ruff", "mypy"}  # a newer one may find more, and nothing runs on them


def lowest(requirements: list[str]) -> dict[str, Version]:
    """Return the version behind ">=" for each name; anything but one such bound is an error."""
    found = {}
    for requirement in map(Requirement, requirements):
        (bound,) = requirement.specifier
        assert bound.operator in (">=", "=="), requirement
        found[requirement.name] = Version(bound.version)
    return found


def test_the_floors_of_ci_are_the_oldest_versions_that_the_project_allows() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    tables = project["project"]
    allowed = lowest([*tables["dependencies"], *tables["optional-dependencies"]["test"]])
    lines = (ROOT / ".ci" / "floors.txt").read_text("utf-8").splitlines()
    installed = lowest([line for line in lines if not line.startswith("#")])
    assert installed == {name: version for name, version in allowed.items() if name not in JUDGES}
    assert lowest(project["build-system"]["requires"])["hatchling"] == allowed["hatchling"]


def test_another_floor_is_seen() -> None:
    assert lowest(["numpy>=1.26"]) == lowest(["numpy==1.26.0"])
    assert lowest(["numpy>=1.26"]) != lowest(["numpy==1.26.1"])
