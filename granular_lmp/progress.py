"""Progress bar of a run or a study, in a terminal or a notebook, with tqdm."""

from time import monotonic
from typing import Any

__all__ = ["ProgressBar"]

DELAY = 0.3  # s before a bar is drawn: faster runs need no bar, and do not wait for the import of tqdm


class ProgressBar:
    """Callback that draws a bar, for the argument `progress` of `run`, `resume`, `sweep` and other studies.

    Examples
    --------
    >>> scene = Scene.load("tr_periodic").with_values({"time.duration": 4.0})
    >>> record = run(scene, "runs/shown", progress=ProgressBar())
    """

    def __init__(self) -> None:
        self._began = monotonic()
        self._bar: Any = None

    def __call__(self, done: int, total: int, left: float | None = None) -> None:
        """Show the finished steps or runs and, for a study, its estimate of the remaining seconds."""
        if self._bar is None:
            if monotonic() - self._began < DELAY:
                return
            from tqdm.auto import tqdm

            form = "{percentage:3.0f}%|{bar:30}| {n_fmt} of {total_fmt} {unit}{postfix}"
            unit = "steps" if left is None else "runs"
            self._bar = tqdm(total=total, unit=unit, bar_format=form, leave=False)
        self._bar.n, self._bar.total = done, total
        if left is not None:
            self._bar.set_postfix_str(f"{left:.0f} s left", refresh=False)
        self._bar.refresh()
        if done >= total:
            self.close()

    def close(self) -> None:
        """Remove the bar; it is drawn again if there is more to do."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None
