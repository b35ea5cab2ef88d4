"""truth.json: the true map of a virtual laboratory, and the hidden effects of its scan."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydantic import Field, JsonValue

from identify.map import GaussianMap, Inclusion
from palpmap.record import FileRecord, Record

FILE = "truth.json"


class HiddenEffectRecord(Record):
    """An effect that is hidden in a scan."""

    name: str
    category: str = Field(description="structured, compliance or outsider")
    law: str = Field(default="", description="what is done, in one line")
    values: Mapping[str, float] = Field(default={}, description="its parameters, SI units")
    wanted_size: float | None = Field(
        default=None, description="size asked for, of the signal's rms"
    )
    size: float = Field(default=0.0, description="size reached, of the signal's rms")
    kin: tuple[str, ...] = Field(default=(), description="nearest effects of the catalogue")


class TrueLawRecord(Record):
    """Stress over strain of the whole body."""

    kind: str = Field(description="neo-hookean, yeoh or fung")
    coefficient: float = Field(description="of the stiffening")
    friction: bool = Field(description="the surface sticks to the tip; else it slides")


class TrueCreepRecord(Record):
    """Parts of the immediate travel by which it grows under a held force."""

    shares: tuple[float, ...]
    times_s: tuple[float, ...] = Field(description="of retardation, s")


class TrueBodyRecord(Record):
    """The true map, and what the body has beside it."""

    background_pa: float = Field(description="Young's modulus of the background, Pa")
    inclusions: tuple[Inclusion, ...] = Field(description="in the body's frame, m and Pa")
    gradient: float | None = Field(
        default=None, description="hidden exponent of the modulus over z"
    )
    poisson_ratio: float | None = Field(default=None, description="hidden Poisson's ratio")
    regions_pa: Mapping[str, float] | None = Field(
        default=None, description="Young's modulus of the regions of a label volume, by label"
    )
    law: TrueLawRecord | None = Field(default=None, description="null of a linear body")
    creep: TrueCreepRecord | None = Field(default=None, description="null of an elastic body")

    @property
    def map(self) -> GaussianMap:
        """The map as a fit finds it."""
        return GaussianMap(self.background_pa, self.inclusions)


class TruthRecord(FileRecord):
    """truth.json of `palpmap scan`."""

    body: TrueBodyRecord
    effects: tuple[HiddenEffectRecord, ...] | None = Field(
        default=None, description="what is hidden"
    )

    def to_dict(self) -> dict[str, JsonValue]:
        """Return what the JSON file holds: of what is not hidden, nothing."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)


def read_truth(path: Path, *, foreign: bool = False) -> GaussianMap | None:
    """Read the true map of a virtual laboratory; None without a file, and of labelled regions.

    Parameters
    ----------
    foreign : the file may be another laboratory's own, whose lack of a map is no fault

    Raises
    ------
    InputError
        The file is no JSON or holds no such map, and is not foreign.
    """
    if not path.is_file():
        return None
    if not foreign:
        body = TruthRecord.read(path).body
        return None if body.regions_pa else body.map
    try:
        content = json.loads(path.read_text(encoding="utf-8"))["body"]
        body = TrueBodyRecord.model_validate(content)
    except (OSError, KeyError, TypeError, ValueError):
        return None
    return None if body.regions_pa else body.map


def matched(found: GaussianMap, truth: GaussianMap) -> dict[str, float]:
    """Return the truth's parameters under the names of the found inclusions nearest to them.

    Inclusions have no order of their own: each true one goes to the nearest found one that is
    still free.
    """
    values = {"background_pa": truth.background_pa}
    free = dict(enumerate(found.inclusions, start=1))
    for inclusion in truth.inclusions:
        if not free:
            break
        centre = np.array([inclusion.x_m, inclusion.y_m, inclusion.z_m])
        nearest = min(
            free, key=lambda i: np.linalg.norm(centre - (free[i].x_m, free[i].y_m, free[i].z_m))
        )
        del free[nearest]
        for name, value in vars(inclusion).items():
            values[f"inclusion_{nearest}.{name}"] = value
    return values
