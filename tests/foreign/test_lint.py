"""``granular-lmp lint``: each fault is found by its check and by no other, and right decks have no warning."""

from pathlib import Path

import pytest

from granular_lmp.foreign.lint import CHECKS, lint
from granular_lmp.foreign.reading import Reading, read
from granular_lmp.lammps.installation import lammps_module, of_wheels
from tests.foreign.decks import DECKS, FAULTS, SHEARED

ROOT = Path(__file__).parents[2]
SHIPPED = sorted((ROOT / "lammps_inputs").rglob("in.*"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what the decks read."""
    place = tmp_path_factory.mktemp("decks")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        lmp = lammps_module().lammps(cmdargs=["-log", "none", "-screen", "none"])
        lmp.commands_string(SHEARED)
        lmp.close()
    return place


def found(reading: Reading) -> list[str]:
    return [check.name for check, _ in lint(reading)]


def wrong(name: str, changes: list[tuple[str, str]]) -> str:
    text = DECKS[name]
    for right, other in changes:
        assert right in text
        text = text.replace(right, other, 1)
    return text


@pytest.mark.parametrize("name", DECKS)
def test_a_right_deck_has_no_warning_and_is_read_to_its_end(folder: Path, name: str) -> None:
    (folder / f"in.{name}").write_text(DECKS[name])
    reading = read(folder / f"in.{name}")
    assert not reading.stopped
    assert reading.spheres is not None
    assert found(reading) == []


@pytest.mark.parametrize(("check", "name", "changes"), FAULTS, ids=[fault[0] for fault in FAULTS])
def test_a_fault_is_found_by_its_check_and_by_no_other(
    folder: Path, check: str, name: str, changes: list[tuple[str, str]]
) -> None:
    text = wrong(name, changes)
    (folder / f"in.{check}").write_text(text)
    ((by, finding),) = lint(read(folder / f"in.{check}"))
    assert by.name == check
    assert finding.command is not None
    written = text.splitlines()[finding.command.line - 1].split()
    assert written[0] == finding.command.name
    assert finding.what
    assert finding.mend


def test_each_check_has_a_deck_with_its_fault() -> None:
    assert sorted(check.name for check in CHECKS) == sorted(fault[0] for fault in FAULTS)


@pytest.mark.parametrize("deck", SHIPPED, ids=lambda deck: deck.name)
def test_a_shipped_deck_has_no_warning(deck: Path) -> None:
    reading = read(deck)
    assert reading.spheres is not None
    assert reading.laws
    assert found(reading) == []


@pytest.mark.parametrize(
    "name",
    [
        "in.chute",
        *(pytest.param(each, marks=pytest.mark.more) for each in ("in.chute.scaled", "POTENTIALS/in.granular")),
    ],
)
def test_a_granular_benchmark_of_lammps_has_no_warning(name: str) -> None:
    decks = of_wheels(f"lammps/share/lammps/bench/{name}")
    if not decks:
        pytest.skip("this LAMMPS comes without its benchmarks")
    reading = read(decks[0])
    assert reading.spheres is not None
    assert len(reading.spheres.id) == 32000
    assert found(reading) == []


def test_what_is_judged_is_the_first_long_run(folder: Path) -> None:
    text = DECKS["sheet"].replace("timestep 0.025", "timestep 0.25")
    (folder / "in.cleared").write_text(f"{text}clear\nunits lj\npair_style zero 1.0\n")
    reading = read(folder / "in.cleared")
    assert (reading.stopped, reading.units, reading.dimension) == ("", "nano", 2)
    assert found(reading) == ["time-step", "collision-time"]


def test_nothing_is_written_beside_the_deck(folder: Path) -> None:
    text = DECKS["sheet"] + "fix seen all ave/time 10 1 10 v_kicks file averages.txt\nwrite_data left.data\n"
    (folder / "in.writing").write_text(text.replace("run 2000", "variable kicks equal vx[1]\nlog mine.log\nrun 2000"))
    before = sorted(folder.iterdir())
    assert not read(folder / "in.writing").stopped
    assert sorted(folder.iterdir()) == before
