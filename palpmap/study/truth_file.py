"""The file of a true body, in TOML: map, law and creep of the virtual laboratory's.

    background_pa = 6000
    [[inclusions]]
    weight_pa = 18000
    x_m = 0.058
    y_m = 0.040
    z_m = 0.018
    radius_m = 0.009

    [regions]             # optional: moduli of the regions of a label volume
    file = "labels.vti"
    moduli_pa = { 1 = 24000, 2 = 3000 }

    [law]                 # optional: hyperelastic in place of linear
    kind = "fung"         # neo-hookean, yeoh or fung
    coefficient = 2.0
    friction = true       # false: the surface slides along under the tip

    [creep]               # optional: the travel grows to 1 + sum(shares) under a held force
    shares = [0.2, 0.1]
    times_s = [0.5, 5.0]

Positions are in the scan's frame, as in the study.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from models import InputError
from palpmap.study.body import File, NotNegative, Positive, Real, Table, as_tuple
from palpmap.study.body_model import points_of
from palpmap.study.checks import refuse_wide
from palpmap.study.faults import read_table
from palpmap.study.label_file import read_label_volume
from palpmap.study.study import Study

if TYPE_CHECKING:
    from fem.finite_strain import HyperelasticLaw
    from identify.map import Inclusion
    from sim.body import Creep, TruthMap
    from sim.scan import Earlier


class TrueInclusion(Table):
    """One entry of `[[inclusions]]`: a Gaussian spot that adds to the background."""

    weight_pa: Real = Field(description="modulus that it adds in its centre, Pa")
    x_m: Real
    y_m: Real
    z_m: Real
    radius_m: Positive = Field(description="standard deviation of the Gaussian, m")


class TrueLaw(Table):
    """`[law]`: stress over strain of the whole body."""

    kind: Literal["neo-hookean", "yeoh", "fung"]
    coefficient: NotNegative = Field(0.0, description="of the stiffening; see fem.finite_strain")
    friction: bool = Field(True, description="the surface sticks to the tip; else it slides")


class TrueCreep(Table):
    """`[creep]`: parts of the immediate travel by which it grows, with their times."""

    shares: tuple[Positive, ...]
    times_s: tuple[Positive, ...]

    @model_validator(mode="after")
    def _one_time_a_share(self) -> TrueCreep:
        if len(self.shares) != len(self.times_s) or not self.shares:
            raise ValueError("one time for each share, at least one")
        return self


class TrueRegions(Table):
    """`[regions]`: moduli of the regions of a label volume; others have the background's."""

    file: File
    unit_m: Positive | None = Field(None, description="length of the file's unit, m")
    moduli_pa: dict[int, Positive] = Field(min_length=1, description="by label, Pa")


class TruthFile(Table):
    """A true body."""

    background_pa: Positive
    regions: TrueRegions | None = None
    inclusions: Annotated[tuple[TrueInclusion, ...], BeforeValidator(as_tuple)] = ()
    law: TrueLaw | None = None
    creep: TrueCreep | None = None


@dataclass(frozen=True)
class Truth:
    """A true body.

    Attributes
    ----------
    map : in the body's frame
    law, creep : None: linear, elastic
    sticking : the surface of a hyperelastic body sticks to the tip; else it slides
    earlier : scans of it before, whose effects act again
    """

    map: TruthMap
    law: HyperelasticLaw | None = None
    creep: Creep | None = None
    earlier: Earlier | None = None
    sticking: bool = True


def read_truth(path: str | os.PathLike[str], study: Study) -> Truth:
    """Read a true body, its map moved into the frame of the study's body.

    Raises
    ------
    InputError
        Naming file and key, what was found and what is expected.
    """
    from sim.body import Creep, TruthMap
    from sim.body import Inclusion as TrueSpot

    path = Path(path)
    found = read_table(path, TruthFile, "true map")
    origin = np.array(study.body.origin_m)
    refuse_outside(found.inclusions, study, f"{path}, key inclusions", scans=True)
    spots = tuple(
        TrueSpot(
            spot.weight_pa,
            tuple((np.array([spot.x_m, spot.y_m, spot.z_m]) - origin).tolist()),
            spot.radius_m,
        )
        for spot in found.inclusions
    )
    volume, moduli = None, {}
    if found.regions is not None:
        file, moduli = path.resolve().parent / found.regions.file, found.regions.moduli_pa
        volume = read_label_volume(file, found.regions.unit_m)
        if absent := sorted(moduli.keys() - set(volume.names)):
            raise InputError(
                f"{path}, key regions.moduli_pa: found the label {absent[0]}, expected labels of "
                f"{file}: {', '.join(map(str, volume.names))}"
            )
        volume = volume.moved(-origin)
    law = found.law and law_of(found.law.kind, found.law.coefficient)
    creep = found.creep and Creep(found.creep.shares, found.creep.times_s)
    sticking = found.law is None or found.law.friction
    truth = TruthMap(found.background_pa, spots, volume, moduli)
    return Truth(truth, law, creep, sticking=sticking)


def refuse_outside(
    spots: Sequence[TrueInclusion | Inclusion], study: Study, where: str, *, scans: bool
) -> None:
    """Refuse an inclusion larger than a study's body, or beside it, which would not be felt.

    Parameters
    ----------
    where : the table of the spots, for sentences
    scans : places are in the frame of the scan; else in the body's

    Raises
    ------
    InputError
        Naming the spot and its key, what was found and what is expected.
    """
    if not spots:
        return
    origin_m = np.array(study.body.origin_m) * scans
    box_m = points_of(study.body)[1]
    for number, spot in enumerate(spots):
        refuse_wide(f"{where}.{number}.radius_m", spot.radius_m, box_m)
        for axis, key in enumerate(("x_m", "y_m", "z_m")):
            place, (low, high) = getattr(spot, key), box_m[:, axis] + origin_m[axis]
            if not low - spot.radius_m <= place <= high + spot.radius_m:
                raise InputError(
                    f"{where}.{number}.{key}: found {place:g} m, expected {low:g} to {high:g} m, "
                    f"inside the body in the {'scan' if scans else 'body'}'s frame; correct the "
                    "place"
                )


def law_of(kind: str, coefficient: float) -> HyperelasticLaw:
    """Return the law of a kind that a file names."""
    from fem.finite_strain import Fung, NeoHookean, Yeoh

    laws = {"neo-hookean": lambda _: NeoHookean(), "yeoh": Yeoh, "fung": Fung}
    return laws[kind](coefficient)


def kind_of_law(law: HyperelasticLaw) -> str:
    """Return the kind of a law, as a file names it."""
    return {"NeoHookean": "neo-hookean", "Yeoh": "yeoh", "Fung": "fung"}[type(law).__name__]
