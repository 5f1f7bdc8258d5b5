"""All checks of a granular wave deck."""

from granular_lmp.foreign import in_contacts, in_files, in_space, in_time
from granular_lmp.foreign.finding import Check, Finding
from granular_lmp.foreign.reading import Reading

CHECKS = (*in_time.CHECKS, *in_contacts.CHECKS, *in_files.CHECKS, *in_space.CHECKS)


def lint(reading: Reading) -> list[tuple[Check, Finding]]:
    """Return the findings in a deck, each with its check, in the order of the checks."""
    if not reading.is_granular:
        return []
    return [(check, finding) for check in CHECKS for finding in check.find(reading)]
