"""The file of a true map, in TOML: what the virtual laboratory's body really is.

    background_pa = 6000
    [[inclusions]]
    weight_pa = 18000
    x_m = 0.058
    y_m = 0.040
    z_m = 0.018
    radius_m = 0.009

Positions are in the scan's frame, as in the study.
"""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, ValidationError

from models import InputError
from palpmap.study.body import Positive, Real, Table
from palpmap.study.study import Study, fault_sentence

if TYPE_CHECKING:
    from sim.body import TruthMap


class TrueInclusion(Table):
    """One entry of `[[inclusions]]`: a Gaussian spot that adds to the background."""

    weight_pa: Real = Field(description="modulus that it adds in its centre, Pa")
    x_m: Real
    y_m: Real
    z_m: Real
    radius_m: Positive = Field(description="standard deviation of the Gaussian, m")


class TruthFile(Table):
    """A true map."""

    background_pa: Positive
    inclusions: tuple[TrueInclusion, ...] = ()


def read_truth(path: str | os.PathLike[str], study: Study) -> TruthMap:
    """Read a true map, moved into the frame of the study's body.

    Raises
    ------
    InputError
        Naming file and key, what was found and what is expected.
    """
    from sim.body import Inclusion, TruthMap

    path = Path(path)
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a true map ({error})") from error
    try:
        found = TruthFile.model_validate(tables)
    except ValidationError as error:
        raise InputError(fault_sentence(path, error, TruthFile)) from error
    origin = np.array(study.body.origin_m)
    spots = tuple(
        Inclusion(
            spot.weight_pa,
            tuple((np.array([spot.x_m, spot.y_m, spot.z_m]) - origin).tolist()),
            spot.radius_m,
        )
        for spot in found.inclusions
    )
    return TruthMap(found.background_pa, spots)
