"""The table of docs/promises.md: which test holds a promise on a path, or why none can.

``python -m tests.promises.table docs/promises.md`` writes it between the marks of the page.
"""

import sys
from pathlib import Path

from tests.pages import placed
from tests.promises.paths import PATHS

SUITE = "tests/promises/test_promises.py"
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


def written() -> str:
    """Return the table and its notes in Markdown."""
    notes: dict[str, int] = {}

    def cell(promise: str, path: str) -> str:
        said = ELSEWHERE.get((promise, path)) or NOT.get((promise, path))
        if said is None:
            return "yes"
        number = notes.setdefault(f"`{said}`" if "::" in said else said, len(notes) + 1)
        return f"yes ({number})" if "::" in said else f"no ({number})"

    head = f"| promise | {' | '.join(PATHS)} |\n|---|{'---|' * len(PATHS)}"
    rows = [f"| {promise} | {' | '.join(cell(promise, path) for path in PATHS)} |" for promise in PROMISES]
    return "\n".join([head, *rows, "", *(f"{number}. {said}" for said, number in notes.items())]) + "\n"


def current(page: str) -> str:
    """Return a page with the table as it is now."""
    return placed(page, "table", written())


if __name__ == "__main__":
    page = Path(sys.argv[1])
    page.write_text(current(page.read_text(encoding="utf-8")), encoding="utf-8")
