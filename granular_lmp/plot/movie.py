"""Movies of a figure, as GIF or MP4."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from subprocess import CalledProcessError

import numpy as np
from matplotlib import colormaps
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from PIL import Image

from granular_lmp.errors import ViewError, one_line
from granular_lmp.lammps.outputs import whole
from granular_lmp.plot.signals import Picture, resized

FRAMES_PER_SECOND = 10
MOVIES = (".gif", ".mp4")
MARK = "C3"
FASTEST = 50  # frames a second, which is what a GIF can have
_WIDTH = 560  # pixels, on which letters of 8 points are ten high


def refuse_movie(path: Path) -> None:
    """Raise ViewError if an MP4 needs the program ffmpeg, which is missing."""
    if path.suffix.lower() != ".gif" and not FFMpegWriter.isAvailable():
        raise ViewError(f"{path}: needs the program ffmpeg, which was not found; a .gif does without")


def write_movie(
    figure: Picture,
    show: Callable[[int], None],
    count: int,
    path: Path,
    colours: str,
    fps: float = FRAMES_PER_SECOND,
    size: tuple[int, int] | None = None,
) -> None:
    """Write a movie of a figure, whose frames `show` makes by their number; `colours` is its colour map.

    It has `fps` frames a second, and `size` pixels along width and height (`resized`).

    Raises
    ------
    RunFolderError
        If the file cannot be written.
    ViewError
        If ffmpeg fails.
    """

    def frames() -> Iterator[Picture]:
        for number in range(count):
            show(number)
            yield figure
            figure.set_layout_engine("none")  # all frames keep the layout of the first, which takes most of its time

    if not 0 < fps <= FASTEST:
        raise ViewError(f"fps = {fps!r}: must be above 0, and at most {FASTEST}")
    figure.set_dpi(resized(figure, size) if size else _WIDTH / figure.get_figwidth())
    try:
        with whole(path) as draft:
            if path.suffix.lower() == ".gif":
                _write_gif(figure, frames(), draft, colours, fps)
            else:
                writer = FFMpegWriter(fps=fps)  # type: ignore[arg-type]  # ffmpeg takes fractions
                with writer.saving(figure, str(draft), dpi=figure.dpi):
                    for _ in frames():
                        writer.grab_frame()
    except CalledProcessError as error:
        raise ViewError(f"{path}: ffmpeg failed with exit status {error.returncode}") from error
    except RuntimeError as error:  # a user's settings of matplotlib may need LaTeX
        raise ViewError(f"{path}: cannot be drawn: {one_line(error)}") from error


def _write_gif(figure: Picture, frames: Iterable[Picture], path: Path, colours: str, fps: float) -> None:
    """Write a GIF with one palette, without dither, for all frames of a figure.

    The file is half as large as that of matplotlib's writer and does not flicker.
    """
    shades = [colormaps[colours](np.linspace(0, 1, 216)), colormaps["gray"](np.linspace(0, 1, 32))]
    shades.append(LinearSegmentedColormap.from_list("", [MARK, "white"])(np.linspace(0, 1, 8)))
    palette = Image.new("P", (1, 1))
    palette.putpalette((255 * np.vstack(shades)[:, :3]).round().astype(np.uint8).tobytes())
    images: list[Image.Image] = []
    canvas = FigureCanvasAgg(figure)  # one for all frames: it keeps the formulas that it has set
    for _ in frames:
        canvas.draw()
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        images.append(image.quantize(palette=palette, dither=Image.Dither.NONE))
    # What shows one picture of a movie shows the first, where nothing moves yet: it goes round, so its end comes first
    images[-1].save(path, save_all=True, append_images=images[:-1], duration=round(1000 / fps), loop=0)
