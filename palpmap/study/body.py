"""The study file's table `[body]`, and the kinds of values that all its tables share."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from models import InputError
from palpmap.study.faults import argument_sentence

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Real, Field(gt=0)]
NotNegative = Annotated[Real, Field(ge=0)]
Side = Literal["x0", "x1", "y0", "y1"]  # of a block, where x or y is 0 or greatest


def _edge(value: float) -> float:
    if not 1e-6 <= value <= 1e3:
        raise ValueError("an edge from 1e-6 to 1000 m")
    return value


def as_tuple(value: Any) -> Any:
    """Return a list of a TOML file as a tuple, anything else as it is."""
    return tuple(value) if isinstance(value, list) else value


def _three(value: Any) -> Any:
    if isinstance(value, (list, tuple, np.ndarray)) and len(value) == 3:
        return tuple(value)
    raise ValueError("three numbers [x, y, z] in m")


def _sides(value: Any) -> Any:
    if isinstance(value, (list, tuple)) and len(set(map(str, value))) == len(value):
        return tuple(value)
    raise ValueError('a list of sides, each once, as ["x0", "y1"]')


def _path(value: Any) -> Any:
    if isinstance(value, str) and value.strip():
        return Path(value)
    if isinstance(value, Path):
        return value
    raise ValueError("the name of a file, as text")


Point = Annotated[tuple[Real, Real, Real], BeforeValidator(_three)]

Edge = Annotated[Positive, AfterValidator(_edge)]
Size = Annotated[tuple[Edge, Edge, Edge], BeforeValidator(_three)]
File = Annotated[Path, BeforeValidator(_path)]


class _MadeInPython(type(BaseModel)):
    """Tables made by their class's name, not read from a file: a fault is one sentence."""

    if not TYPE_CHECKING:  # checkers see the tables' own arguments

        def __call__(cls, **values):
            try:
                return super().__call__(**values)
            except ValidationError as error:
                raise InputError(argument_sentence(error, cls)) from error


class Table(BaseModel, metaclass=_MadeInPython):
    """A table of a study file: frozen, without unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Body(Table):
    """`[body]`: the soft body.

    A block's corner stands at `origin_m` in the scan's frame, x and y in [0, size], z up from the
    base. With `project_points` a block stands in for a body with a curved surface: contact points
    are moved along z onto its top and directions are replaced by the top's normal. A body "from
    contacts" has the surface that the contact points and press directions of a scan span
    (`palpmap.study.contact_body`): of the study's own scan, or of the one named by `file`; its flat
    base lies `thickness_m` below their mean height, its sides `margin_m` beyond them; a margin that
    is not stated is found (`palpmap.sides`), and is then `margin_assumed`. `cell_size_m` is the
    size of the finite elements of the coarser of two meshes (`palpmap.study.body_model`).

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.Body(shape="block", size_m=(0.1, 0.1, 0.05), poisson_ratio=0.49).support
    'base-bonded'
    """

    shape: Literal["block", "surface", "from-contacts"] = Field(
        description="'block', 'surface' or 'from-contacts'"
    )
    size_m: Size | None = None
    thickness_m: Edge | None = None
    margin_m: Edge | None = None
    cell_size_m: Positive | None = None
    file: File | None = None
    poisson_ratio: Real = Field(ge=0, le=0.4999, description="Poisson's ratio, 0 to 0.4999")
    support: Literal["base-bonded", "base-sliding", "base-elastic"] = "base-bonded"
    base_normal_m_per_pa: NotNegative | None = None
    base_tangential_m_per_pa: NotNegative | None = None
    held_sides: Annotated[tuple[Side, ...], BeforeValidator(_sides)] = ()
    origin_m: Point = (0.0, 0.0, 0.0)
    project_points: bool = Field(False, strict=True)
    thickness_assumed: bool = Field(False, strict=True)
    margin_assumed: bool = Field(False, strict=True)

    @classmethod
    def made_from(cls, found: object) -> str:
        """Return how one is made, for a sentence about another thing found in its place."""
        return "pm.Block((0.1, 0.1, 0.05), poisson_ratio=0.49)"

    @model_validator(mode="after")
    def _shape_has_its_keys(self) -> "Body":
        if self.shape == "block" and (self.size_m is None or self.file is not None):
            raise ValueError('size_m = [x, y, z] in m and no file, as shape is "block"')
        if self.shape == "surface" and (self.file is None or self.size_m is not None):
            raise ValueError('file = "... .stl" and no size_m, as shape is "surface"')
        contacts = self.shape == "from-contacts"
        if contacts and (self.thickness_m is None or self.size_m is not None):
            raise ValueError('thickness_m in m and no size_m, as shape is "from-contacts"')
        if not contacts and (self.thickness_m, self.margin_m) != (None, None):
            raise ValueError('thickness_m and margin_m only with shape = "from-contacts"')
        if self.margin_assumed and self.margin_m is None:
            raise ValueError("margin_m, as margin_assumed is true")
        if self.project_points and self.shape != "block":
            raise ValueError('project_points only with shape = "block"')
        if self.thickness_assumed and self.shape == "surface":
            raise ValueError(
                'thickness_assumed only with shape = "block" or shape = "from-contacts"'
            )
        return self

    @model_validator(mode="after")
    def _support_has_its_keys(self) -> "Body":
        springs = (self.base_normal_m_per_pa, self.base_tangential_m_per_pa)
        if self.support == "base-elastic" and None in springs:
            raise ValueError(
                "base_normal_m_per_pa and base_tangential_m_per_pa (0 holds the base in that "
                'direction), as support is "base-elastic"'
            )
        if self.support != "base-elastic" and springs != (None, None):
            raise ValueError(
                "no base_normal_m_per_pa and base_tangential_m_per_pa, as support is "
                f'"{self.support}"; they belong to support = "base-elastic"'
            )
        if self.held_sides and self.shape == "surface":
            raise ValueError('no held_sides, as shape is "surface", which has no named sides')
        return self
