"""Parameters of a test that only `make validate` takes, beside those of every day."""

from collections.abc import Iterable
from typing import Any

import pytest


def long(*parameters: Any) -> Iterable[Any]:
    """Mark parameters as slow; a tuple is the set of parameters of one test."""
    return [
        pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=pytest.mark.slow)
        for one in parameters
    ]
