"""The error that a user's input causes."""


class InputError(ValueError):
    """Input that cannot be used: one sentence with what, where, what was expected, what to do.

    Examples
    --------
    >>> import palpmap as pm
    >>> try:
    ...     pm.FlatTip(-0.005)
    ... except pm.InputError as error:
    ...     print(error)
    radius_m: found -0.005, expected greater than 0
    """
