"""The clock of a scene: one time step, or a ladder of steps that get smaller until the error is small enough.

Both have the same properties, so only code that starts or continues runs (`granular_lmp.accuracy.tolerance`) has to
tell them apart. The first step of a ladder follows from the problem (`granular_lmp.accuracy.ladder`).
"""

from collections.abc import Callable, Sequence
from math import ceil, inf

from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass

RUNGS = 3  # planned runs of a ladder, with the steps h, h/2, h/4


@dataclass(frozen=True)
class Step:
    """One run with one time step.

    Attributes
    ----------
    longest : float
        Declared step, units of time.
    sample : float
        Time between two records.
    """

    longest: float
    sample: float
    tolerance = inf

    @property
    def per_sample(self) -> int:
        """Steps between two records; the step is rounded down to fit."""
        return ceil(self.sample / self.longest - 1e-9)  # the deck applies the same rule, with the same slack

    @property
    def of_answer(self) -> float:
        """Time step of the record."""
        return self.sample / self.per_sample

    @property
    def declared(self) -> tuple[float, ...]:
        """Declared time steps."""
        return (self.longest,)

    @property
    def as_run(self) -> dict[str, float]:
        """Key and value that the run has in the table ``[time]``."""
        return {"timestep": self.of_answer}

    @property
    def chosen(self) -> tuple[float, str]:
        """Declared number, and a sentence with a place for it that says how the step is chosen."""
        return self.of_answer, "the step is {} t0"

    def counts(self, first: Callable[[float], int]) -> tuple[int, ...]:
        """Return the steps per sample of each planned run."""
        return (self.per_sample,)

    def between(self, steps: Sequence[int], apart: float) -> float:
        """Return the time between two steps of a dump, from its steps per record and the time between two records."""
        return self.of_answer

    def left(self, estimate: float | None) -> float:
        """Return the error that the runs estimated for themselves; a single run estimates none."""
        return 0.0

    def refuse_ladder(self, why: str) -> None:
        """Raise SceneError if the clock is a ladder, where only one run can be made."""


@dataclass(frozen=True)
class Ladder:
    """Runs with ever smaller steps, whose results are extrapolated to step 0.

    Attributes
    ----------
    tolerance : float
        Largest error of the answer.
    """

    tolerance: float
    of_answer = 0.0
    declared = ()

    @property
    def per_sample(self) -> int:
        """Raise SceneError: each run has its own; use ``scene.with_values({"time.timestep": step})``."""
        raise self._refused("the scene has no time step until one is chosen")

    @property
    def as_run(self) -> dict[str, float]:
        """Key and value that the run has in the table ``[time]``."""
        return {"tolerance": self.tolerance}

    @property
    def chosen(self) -> tuple[float, str]:
        """Declared number, and a sentence with a place for it that says how the step is chosen."""
        return self.tolerance, "a tolerance of {} chooses the step"

    def counts(self, first: Callable[[float], int]) -> tuple[int, ...]:
        """Return the steps per sample of each planned run; `first` gives the steps of the first run, by tolerance."""
        fewest = first(self.tolerance)
        return tuple(fewest << rung for rung in range(RUNGS))

    def between(self, steps: Sequence[int], apart: float) -> float:
        """Return the time between two steps of a dump, from its steps per record and the time between two records."""
        return apart / steps[1] if len(steps) > 1 else apart

    def left(self, estimate: float | None) -> float:
        """Return the error that the runs estimated for themselves, or the tolerance if they estimated none."""
        return self.tolerance if estimate is None else estimate

    def refuse_ladder(self, why: str) -> None:
        """Raise SceneError if the clock is a ladder, where only one run can be made."""
        raise self._refused(why)

    def _refused(self, why: str) -> SceneError:
        return SceneError(f"time.tolerance = {self.tolerance!r}: {why}")
