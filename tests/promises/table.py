"""The table of docs/promises.csv: which test holds a promise on a path, or why none can.

``python -m tests.promises.table`` writes it.
"""

from pathlib import Path

from tests.pages import write_table
from tests.promises.paths import PATHS

TABLE = Path(__file__).parents[2] / "docs" / "promises.csv"
# Promise → the test of the suite that holds it
PROMISES = {
    "numbers under the right name": "test_numbers_are_what_the_dump_and_the_deck_say",
    "error estimate": "test_an_estimate_is_at_least_half_the_error",
    "tolerance": "test_an_answer_errs_by_less_than_its_tolerance",
    "error budget": "test_the_error_of_a_step_is_at_most_what_the_budget_says",
    "same bytes after resume": "test_a_stopped_run_is_continued_to_the_same_bytes",
    "what was changed is refused": "test_a_file_that_was_changed_is_refused",
    "guards": "test_a_guard_fails_the_run",
    "clear errors": "test_bad_input_is_one_line",
}
_SWEEPS = "tests/studies/test_sweep.py::test_"
# Tests of other files
ELSEWHERE = {
    ("same bytes after resume", "sweep"): f"{_SWEEPS}a_run_that_was_cut_off_is_continued_to_the_same_bytes",
    ("guards", "sweep"): "tests/studies/test_far_sphere.py::test_a_guard_that_triggers_fails_its_run_alone",
}
# Reasons why a cell is empty
NOT = {
    ("error budget", "impact"): "one run of an impact says nothing of its error: `time.tolerance` does",
    ("error budget", "collision"): "`collide` prints the error of each number, from a run with twice the step",
}


def covered(promise: str) -> list[str]:
    """Return the paths on which the test of the suite holds a promise."""
    return [path for path in PATHS if (promise, path) not in {**ELSEWHERE, **NOT}]


def rows() -> list[list[str]]:
    """Return the table, its head first; a cell names the test of another file that holds it, or why it is empty."""

    def cell(promise: str, path: str) -> str:
        if elsewhere := ELSEWHERE.get((promise, path)):
            return f"yes, by {elsewhere}"
        reason = NOT.get((promise, path))
        return f"no: {reason}" if reason else "yes"

    return [["promise", *PATHS], *([promise, *(cell(promise, path) for path in PATHS)] for promise in PROMISES)]


if __name__ == "__main__":
    write_table(TABLE, rows())
