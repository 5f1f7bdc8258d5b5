"""What makes a figure hard to read on a page: small letters, texts on texts or beyond the edge, legends on data."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.text import Text
from matplotlib.transforms import Bbox

WIDEST = 6.3  # inches, 16 cm: the width of a page; a figure that is wider is made smaller on it
SMALLEST = 8.0  # points
ROUNDED = 0.05  # points that the 16 cm of a page, 6.3 inches, are rounded by
TOUCH = 0.01  # inches by which boxes around texts may overlap: they hold empty space below and above letters


@contextmanager
def faults() -> Iterator[list[str]]:
    """Yield a list that holds what is hard to read on the figure that was drawn last, a line each.

    Only texts that are drawn count: ticks keep others beyond the ends of their axis.
    """
    found: list[str] = []
    texts: list[Text] = []
    draw_figure, draw_text = Figure.draw, Text.draw

    def figure(self: Figure, *arguments: Any, **options: Any) -> None:
        texts.clear()
        draw_figure(self, *arguments, **options)
        found[:] = [*of_texts(self, texts), *of_legends(self)]

    def text(self: Text, *arguments: Any, **options: Any) -> None:
        if self.get_visible() and self.get_text().strip():
            texts.append(self)
        draw_text(self, *arguments, **options)

    Figure.draw, Text.draw = figure, text  # type: ignore[method-assign]
    try:
        yield found
    finally:
        Figure.draw, Text.draw = draw_figure, draw_text  # type: ignore[method-assign]


def of_texts(figure: Figure, texts: list[Text]) -> Iterator[str]:
    """Yield what is wrong with the texts of a figure: their size, what is cut off, and what overlaps."""
    shown = min(1.0, WIDEST / figure.get_figwidth())
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts]
    for text in texts:
        if text.get_fontsize() * shown < SMALLEST - ROUNDED:
            yield f"{text.get_text()!r} has {text.get_fontsize() * shown:.1f} points"
    touch = TOUCH * figure.dpi
    for words, box in boxes:
        if beyond(box, figure.bbox) > touch:
            yield f"{words!r} is cut off"
    for (one, first), (other, second) in combinations(boxes, 2):
        if shared(first, second) > touch:
            yield f"{one!r} overlaps {other!r}"


def beyond(box: Bbox, edge: Bbox) -> float:
    """Return by how much a box lies beyond an edge, in pixels."""
    return max(edge.x0 - box.x0, edge.y0 - box.y0, box.x1 - edge.x1, box.y1 - edge.y1)


def shared(one: Bbox, other: Bbox) -> float:
    """Return the smaller side of what two boxes share, in pixels; below 0 if they are apart."""
    return min(min(one.x1, other.x1) - max(one.x0, other.x0), min(one.y1, other.y1) - max(one.y0, other.y0))


def of_legends(figure: Figure) -> Iterator[str]:
    """Yield the axes of which a legend covers a line or a point; it may cover a line across all of the axes."""
    legends = [each.get_window_extent() for each in figure.findobj(Legend) if each.get_visible()]
    for axes in figure.axes:
        lines = [line for line in axes.lines if line.get_transform() == axes.transData and line.get_visible()]
        paths = [line.get_path().transformed(line.get_transform()) for line in lines]
        drawn = [path for path, line in zip(paths, lines, strict=True) if line.get_linestyle() != "None"]
        points = [np.asarray(path.vertices) for path in paths]
        points += [axes.transData.transform(np.asarray(each.get_offsets())) for each in axes.collections if dots(each)]
        for box in legends:
            within = Bbox.intersection(box, axes.bbox)
            if within is None or min(within.width, within.height) <= 1:
                continue
            if any(path.intersects_bbox(within, filled=False) for path in drawn) or any(
                within.count_contains(each[np.isfinite(each).all(axis=1)]) for each in points
            ):
                yield f"a legend covers data of {axes.get_title('left') or axes.get_title() or axes.get_ylabel()!r}"


def dots(collection: Any) -> bool:
    """Return whether a collection of matplotlib is made of marks at places of its axes."""
    return bool(len(collection.get_offsets())) and collection.get_offset_transform() == collection.axes.transData
