"""Lines of one's own in a deck: where they go, and that a run of them says so."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.tools.compare import compare
from granular_lmp import Scene, build, run
from granular_lmp.accuracy.tolerance import resume
from granular_lmp.errors import DeckError, RunFolderError
from granular_lmp.lammps.edits import differing_lines, places, with_lines
from granular_lmp.runs.record import write_status

PLACES = ["variables", "units", "lattice", "contacts", "preload", "wave", "motion", "guards", "record", "run"]
# A force along x on every mobile sphere, in ag nm/ns2: 1e-5 of the force of a contact, which triggers no guard
PUSH = "fix push mobile addforce 1.0 0.0 0.0"


def test_the_places_of_a_deck_are_its_headings(small: Scene) -> None:
    assert build(small).places == PLACES
    assert "drive" in build(Scene.load("tr_driven")).places
    text = build(small).input_text
    assert "".join(text[begin:end] for begin, end in places(text).values()) == text[text.index("# --- variables") :]


@pytest.mark.parametrize("place", PLACES)
def test_lines_stand_before_and_after_the_block_and_nothing_else_changes(place: str, small: Scene) -> None:
    deck = build(small)
    edited = deck.edited(before={place: "log mine.first"}, after={place: "log mine\nlog mine.last"})
    assert edited.edits() == ["+ log mine.first", "+ log mine", "+ log mine.last"]
    lines = edited.input_text.splitlines()
    first, last = lines.index("log mine.first"), lines.index("log mine.last")
    assert re.match(rf"# --- {place}|{place} \$", lines[first + 1])
    inside = [name for name in PLACES if any(line.startswith(f"# --- {name}") for line in lines[first:last])]
    assert inside in ([place], [])


def test_a_place_that_is_not_there_is_refused_by_name(small: Scene) -> None:
    with pytest.raises(DeckError, match="'contact': no such place in this deck; did you mean 'contacts'"):
        build(small).edited(after={"contact": PUSH})
    with pytest.raises(DeckError, match="'drive': no such place in this deck; allowed: variables, units, lattice"):
        build(small).edited(before={"drive": PUSH})


def test_a_deck_that_was_not_edited_has_no_edits(small: Scene) -> None:
    deck = build(small)
    assert deck.edits() == []
    assert with_lines(deck.input_text, {}, {}) == deck.input_text
    assert differing_lines("a\nb", "a\nc") == ["- b", "+ c"]


def test_a_deck_with_other_comments_has_no_edits(small: Scene) -> None:
    deck = build(small)
    text = re.sub("#(?= ).*", "# said otherwise", deck.input_text)
    assert text != deck.input_text
    assert not replace(deck, input_text=text).edits()
    assert replace(deck, input_text=text.replace("dimension    2", "dimension    3  # said otherwise")).edits() == [
        "- dimension    2",
        "+ dimension    3",
    ]


@pytest.mark.parametrize("comment", ["# the motion &\n", "# the motion & \t\n", '# """\n'])
def test_a_comment_that_swallows_the_next_line_is_an_edit(comment: str, small: Scene) -> None:
    deck = build(small)
    text = deck.input_text.replace("fix          move mobile", f"{comment}fix          move mobile", 1)
    assert text != deck.input_text
    assert replace(deck, input_text=text).edits() == [f"+ {comment.rstrip(chr(10))}"]


def test_asking_for_the_edits_builds_no_lattice(small: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    deck = build(small)
    monkeypatch.setattr("granular_lmp.lammps.start.initial_fields", None)
    assert deck.edits() == []


def test_a_run_of_an_edited_deck_is_another_run_and_says_so(small: Scene, tmp_path: Path) -> None:
    plain = run(small, tmp_path / "plain")
    pushed = run(build(small).edited(after={"motion": PUSH}), tmp_path / "pushed")
    assert np.abs(pushed.q - plain.q).max() > 0
    assert "edited" not in plain.info
    assert pushed.info["edited"] == [f"+ {PUSH}"]
    assert any(
        "its deck was edited, and no theory includes the edits; lines that differ: 1" in note
        for note in compare(pushed).notes
    )
    assert not any("edited" in note for note in compare(plain).notes)


def test_a_run_of_other_spheres_says_so(small: Scene, tmp_path: Path) -> None:
    deck = build(small)
    record = run(replace(deck, data=replace(deck.data, density=2 * deck.data.density)), tmp_path / "heavier")
    assert [line[:36] for line in record.info["edited"]] == [
        "- data.small: density of sphere 1: 0",
        "+ data.small: density of sphere 1: 0",
    ]


def test_an_edited_run_is_not_resumed_without_its_edits(small: Scene, tmp_path: Path) -> None:
    record = run(build(small).edited(after={"motion": PUSH}), tmp_path / "run")
    write_status(tmp_path / "run", record.info | {"status": "interrupted"})
    with pytest.raises(RunFolderError, match="its deck was edited, and resume cannot repeat the edits"):
        resume(tmp_path / "run")
