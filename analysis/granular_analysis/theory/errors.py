"""The error of a theory that refuses: a caller shows its sentence as a reason, and no other error as one."""


class TheoryError(ValueError):
    """A theory whose name is unknown, or that leaves out what it is given."""
