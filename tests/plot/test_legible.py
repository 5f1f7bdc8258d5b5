"""Figures are read on a page: what makes one hard to read is found, and what is committed and drawn has none of it."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from cases.run import Case, drawing
from granular_analysis.cli import main
from granular_lmp import Scene
from granular_lmp.plot.at_rest import at_rest_figure
from granular_lmp.plot.movie import write_movie
from granular_lmp.plot.signals import PAGE, Picture, dispersion_figure
from tests.legible import WIDEST, faults

FIGURES = sorted((Path(__file__).parents[2] / "figures").rglob("*.png"))


def drawn(figure: Figure, path: Path) -> list[str]:
    """Return what is hard to read on a figure, once it is a file."""
    with faults() as found:
        figure.savefig(path)
    return found


def wrong(which: str) -> Figure:
    """Return a figure with one fault, or with none if `which` names none."""
    figure = Figure(figsize=(9.0 if which == "wide" else WIDEST, 3.0), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1, 2], [0, 1, 0], label="a line")
    axes.axhline(0.5)  # across the whole axes: a legend may cover it
    if which == "legend":
        axes.legend(loc="upper center")
    if which == "cut off":
        figure.suptitle(30 * "long title ")
    if which in ("overlap", "apart"):
        axes.text(0.2, 0.9, "one")
        axes.text(0.2, 0.91 if which == "overlap" else 0.7, "other")
    return figure


@pytest.mark.parametrize(
    ("which", "says"),
    [
        ("wide", "'0.00' has 5.6 points"),
        ("legend", "a legend covers data of ''"),
        ("cut off", " is cut off"),
        ("overlap", "'one' overlaps 'other'"),
    ],
)
def test_a_figure_that_is_hard_to_read_is_found(which: str, says: str, tmp_path: Path) -> None:
    assert any(says in line for line in drawn(wrong(which), tmp_path / "x.png"))


def test_a_figure_that_is_read_has_no_faults(tmp_path: Path) -> None:
    assert drawn(wrong("apart"), tmp_path / "x.png") == []


def test_the_pictures_of_the_package_are_read_on_a_page(tmp_path: Path) -> None:
    assert PAGE == WIDEST
    assert drawn(dispersion_figure(Scene.load("tr_nonresonant")), tmp_path / "x.png") == []
    sheet = Scene.load("tr_periodic").with_values({"packing.rows": 8, "packing.columns": 6, "disorder.radius": 1e-4})
    assert drawn(at_rest_figure(sheet.with_values({"effects.contact_opening": True})), tmp_path / "x.png") == []


def test_a_case_is_read_on_a_page(tmp_path: Path) -> None:
    (command,) = drawing(Case.load("figure2"), tmp_path, tmp_path)
    with faults() as found:
        assert main(command[1:]) == 0
    assert found == []


@pytest.mark.parametrize("path", FIGURES, ids=lambda path: path.stem)
def test_a_committed_picture_is_as_wide_as_a_page(path: Path) -> None:
    """So its letters, of at least 8 points in the style of both programs, are as large on the page."""
    with Image.open(path) as picture:
        assert picture.size[0] / picture.info["dpi"][0] == pytest.approx(WIDEST, abs=0.01)


def test_a_gif_begins_with_its_last_frame(tmp_path: Path) -> None:
    """A page that shows one frame of it shows what has happened in place of what is at rest."""
    figure = Picture(figsize=(1.0, 1.0))
    write_movie(figure, lambda number: figure.set_facecolor(str(number / 2)), 3, tmp_path / "x.gif", "gray")
    with Image.open(tmp_path / "x.gif") as movie:
        shades = []
        for number in range(3):
            movie.seek(number)
            shades.append(np.asarray(movie.convert("L"))[0, 0])
    assert shades == [pytest.approx(255, abs=4), 0, pytest.approx(128, abs=4)]  # 248 shades of grey
