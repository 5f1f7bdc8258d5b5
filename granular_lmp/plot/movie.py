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
FASTEST = 50  # frames per second, the limit of a GIF
_WIDTH = 560  # pixels; letters of 8 points are then ten pixels high


def refuse_movie(path: Path) -> None:
    """Raise ViewError if an MP4 needs the program ffmpeg, which is missing."""
    if path.suffix.lower() != ".gif" and not FFMpegWriter.isAvailable():
        raise ViewError(f"{path}: needs the program ffmpeg, which was not found; a .gif works without it")


def write_movie(
    figure: Picture,
    show: Callable[[int], None],
    count: int,
    path: Path,
    colours: str,
    fps: float = FRAMES_PER_SECOND,
    size: tuple[int, int] | None = None,
) -> None:
    """Write a movie of a figure as GIF or MP4.

    Parameters
    ----------
    figure : the figure, which `show` changes from frame to frame
    show : callable
        Called with the number of each frame, from 0 to count − 1.
    count : number of frames
    path : file; the suffix .gif or .mp4 sets the format
    colours : colour map of the figure, for the palette of a GIF
    fps : frames per second
    size : width and height in pixels, as in `resized`

    Raises
    ------
    RunFolderError
        If the file cannot be written.
    ViewError
        If fps or size is out of range, ffmpeg fails, or matplotlib needs a missing program.
    """

    def frames() -> Iterator[Picture]:
        for number in range(count):
            show(number)
            yield figure
            figure.set_layout_engine("none")  # later frames keep the layout of the first, because layout is slow

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
    """Write a GIF with one palette for all frames of a figure, without dither.

    The file is half as large as a file of matplotlib's writer, and does not flicker.
    """
    shades = [colormaps[colours](np.linspace(0, 1, 216)), colormaps["gray"](np.linspace(0, 1, 32))]
    shades.append(LinearSegmentedColormap.from_list("", [MARK, "white"])(np.linspace(0, 1, 8)))
    palette = Image.new("P", (1, 1))
    palette.putpalette((255 * np.vstack(shades)[:, :3]).round().astype(np.uint8).tobytes())
    images: list[Image.Image] = []
    canvas = FigureCanvasAgg(figure)  # one canvas for all frames, because it caches the formulas that it has rendered
    for _ in frames:
        canvas.draw()
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        images.append(image.quantize(palette=palette, dither=Image.Dither.NONE))
    # The last frame comes first, because previews show only the first frame, and nothing moves yet at the start. The
    # movie loops, so the order stays the same
    images[-1].save(path, save_all=True, append_images=images[:-1], duration=round(1000 / fps), loop=0)
