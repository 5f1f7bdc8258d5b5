"""The table of refusals: what does not go together in a scene, each line physics or not built.

A line is a function that returns what is wrong with a scene, "" if nothing is. `refuse` raises the first, and its error
knows why (`granular_lmp.errors.SceneError.because`): the matrix of features and its page read it there.
"""

from granular_lmp.errors import SceneError
from granular_lmp.rest import (
    refusals_at_rest,
    refusals_of_members,
    refusals_of_values,
    refusals_of_waves,
    refusals_without_wave,
)
from granular_lmp.rest.derived import Derived

REFUSALS = (
    *refusals_of_values.LINES,
    *refusals_of_members.LINES,
    *refusals_without_wave.LINES,
    *refusals_at_rest.LINES,
    *refusals_of_waves.LINES,
)


def refuse(scene: Derived, variant: str) -> None:
    """Raise a SceneError for the first line that refuses a scene of this kind."""
    for line in REFUSALS:
        if variant in line.of and (sentence := line.says(scene)):
            raise SceneError(sentence, because=line.because)
