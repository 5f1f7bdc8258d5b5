"""The page on decks of one's own: its deck, what lint and compare print of it, and the list of checks."""

import re
from pathlib import Path

import pytest

from cases.own_deck.case import DECK, adopted
from granular_analysis.measure.witness import table, witness
from granular_lmp.cli.entry import main
from granular_lmp.foreign.lint import CHECKS

PAGE = (Path(__file__).parents[2] / "docs/your-own-deck.md").read_text(encoding="utf-8")
(WRITTEN,) = re.findall(r"```lammps.*?\n(.*?)```", PAGE, re.DOTALL)
WARNINGS, PARTED = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)


def test_lint_prints_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("in.chain").write_text(WRITTEN)
    assert main(["lint", "in.chain"]) == 0
    assert capfd.readouterr().out == WARNINGS
    assert main(["lint", "in.chain", "--strict"]) == 1


def test_the_deck_of_the_figure_is_the_mended_one_of_the_page() -> None:
    lines = [*WRITTEN.splitlines()]
    lines[lines.index("timestep 2e-6")] = "timestep 1e-6"
    (mend,) = re.findall(r"mend: (dump_modify.*)", WARNINGS)
    lines.insert(-1, mend)
    assert DECK.read_text(encoding="utf-8").splitlines() == lines


def test_compare_prints_what_the_page_says(tmp_path: Path) -> None:
    crystal = adopted(tmp_path)
    assert table(crystal, witness(crystal)).replace("run:", "chain:", 1) + "\n" == PARTED


def test_the_page_names_every_check() -> None:
    assert {check.name for check in CHECKS} == set(
        re.findall(r"`([a-z-]+-[a-z]+|discs)`", PAGE.partition("| subject |")[2])
    )
