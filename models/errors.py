"""The error that a user's input causes."""


class InputError(ValueError):
    """Unusable input, in one sentence: the fault, its place, the expected form and the cure.

    Examples
    --------
    >>> import palpmap as pm
    >>> try:
    ...     pm.FlatTip(-0.005)
    ... except pm.InputError as error:
    ...     print(error)
    radius_m: found -0.005, expected greater than 0
    """
