"""A tuple whose items are also looked up by their name."""

from __future__ import annotations

import difflib
from typing import Any, SupportsIndex, TypeVar, cast, overload

from models.errors import InputError

T = TypeVar("T", covariant=True)


class Catalogue(tuple[T, ...]):
    """Effects in order; `catalogue["breathing"]` is the one of that name.

    Raises
    ------
    InputError
        No effect has the name; says the nearest right name, or all of them.
    """

    __slots__ = ()

    @overload
    def __getitem__(self, key: str | SupportsIndex) -> T: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[T, ...]: ...
    def __getitem__(self, key: str | SupportsIndex | slice) -> T | tuple[T, ...]:
        """Return the effect of a name or place, or the effects of a slice."""
        if not isinstance(key, str):
            return super().__getitem__(key)
        named = cast("tuple[Any, ...]", self)
        items: dict[str, Any] = {item.name: item for item in named}
        if key in items:
            return items[key]
        near = difflib.get_close_matches(key.lower().replace("-", "_"), items, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else f"there are: {', '.join(items)}"
        raise InputError(f"no effect is called '{key}'; {hint}")
