"""Table of refusals: what cannot be combined in a scene, because of physics or because it is not built.

A line is a function that returns the error of a scene, "" if there is none. `refuse` raises the first error, which
carries its reason (`granular_lmp.errors.SceneError.because`) for the matrix of features and its page.
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
    """Raise SceneError for the first line that refuses a scene of this kind."""
    for line in REFUSALS:
        if variant in line.of and (sentence := line.says(scene)):
            raise SceneError(sentence, because=line.because)
