"""The error that a user's input causes."""


class InputError(ValueError):
    """Input that cannot be used: one sentence with what, where, what was expected, what to do."""
