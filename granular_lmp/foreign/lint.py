"""All checks of a granular wave deck, one after the other."""

from granular_lmp.foreign import in_contacts, in_files, in_space, in_time
from granular_lmp.foreign.finding import Check, Finding
from granular_lmp.foreign.reading import Reading

CHECKS = (*in_time.CHECKS, *in_contacts.CHECKS, *in_files.CHECKS, *in_space.CHECKS)


def lint(reading: Reading) -> list[tuple[Check, Finding]]:
    """Return what may be wrong with a deck, each with the check that found it, in the order of the checks."""
    if not reading.is_granular:
        return []
    return [(check, finding) for check in CHECKS for finding in check.find(reading)]
