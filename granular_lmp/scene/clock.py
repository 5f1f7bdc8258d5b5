"""The clock of a scene: one time step, or a ladder of steps that get smaller until the error is small enough.

Both have the same values, so that only what starts or continues runs (`granular_lmp.accuracy.tolerance`) asks which it
is. The first step of a ladder follows from the problem (`granular_lmp.accuracy.ladder`).
"""

from collections.abc import Callable, Sequence
from math import ceil, inf

from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass

RUNGS = 3  # runs of a ladder that are planned, as of steps h, h/2, h/4


@dataclass(frozen=True)
class Step:
    """One run with a step.

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
        return ceil(self.sample / self.longest - 1e-9)  # the same rule, with the same slack, is written in the deck

    @property
    def of_answer(self) -> float:
        """Step of the record."""
        return self.sample / self.per_sample

    @property
    def declared(self) -> tuple[float, ...]:
        """Declared steps."""
        return (self.longest,)

    @property
    def as_run(self) -> dict[str, float]:
        """Key and value of the table ``[time]`` that the run has."""
        return {"timestep": self.of_answer}

    @property
    def chosen(self) -> tuple[float, str]:
        """Number and sentence that say how the step is chosen."""
        return self.of_answer, "the step is {} t0"

    def counts(self, first: Callable[[float], int]) -> tuple[int, ...]:
        """Return the steps per sample of each run that is planned."""
        return (self.per_sample,)

    def between(self, steps: Sequence[int], apart: float) -> float:
        """Return the time of a step that a dump counts, from the steps of its records and the time between two."""
        return self.of_answer

    def left(self, estimate: float | None) -> float:
        """Return the relative error that runs estimated of themselves; one run estimates none."""
        return 0.0

    def refuse_ladder(self, why: str) -> None:
        """Raise SceneError where only one run can be made."""


@dataclass(frozen=True)
class Ladder:
    """Runs with smaller and smaller steps, whose answer is extrapolated to step 0.

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
        """Raise SceneError, since each run has its own; one is of ``scene.with_values({"time.timestep": step})``."""
        raise self._refused("the scene has no time step until one is chosen")

    @property
    def as_run(self) -> dict[str, float]:
        """Key and value of the table ``[time]`` that the run has."""
        return {"tolerance": self.tolerance}

    @property
    def chosen(self) -> tuple[float, str]:
        """Number and sentence that say how the step is chosen."""
        return self.tolerance, "a tolerance of {} chooses the step"

    def counts(self, first: Callable[[float], int]) -> tuple[int, ...]:
        """Return the steps per sample of each run that is planned; `first` gives those of the first by tolerance."""
        fewest = first(self.tolerance)
        return tuple(fewest << rung for rung in range(RUNGS))

    def between(self, steps: Sequence[int], apart: float) -> float:
        """Return the time of a step that a dump counts, from the steps of its records and the time between two."""
        return apart / steps[1] if len(steps) > 1 else apart

    def left(self, estimate: float | None) -> float:
        """Return the relative error that runs estimated of themselves, or the tolerance where they say none."""
        return self.tolerance if estimate is None else estimate

    def refuse_ladder(self, why: str) -> None:
        """Raise SceneError where only one run can be made."""
        raise self._refused(why)

    def _refused(self, why: str) -> SceneError:
        return SceneError(f"time.tolerance = {self.tolerance!r}: {why}")
