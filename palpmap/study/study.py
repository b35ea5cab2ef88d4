"""The study file: the known facts of an experiment, in TOML beside the scan that it names."""

import os
from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from models import InputError, nearest, replaced, shortened
from palpmap.study.body import Body, File, Positive, Real, Table
from palpmap.study.faults import fault_sentence
from palpmap.study.study_text import study_tables
from palpmap.study.units_check import check_units

SCHEMA = 1
MOST_INCLUSIONS = 100
LARGEST_NUMBER = 1e12  # of pascals or metres: diamond has as many pascals
MOST_SAMPLES = 1_000_000
LEAST_SAMPLES = 1000  # fewer settle no interval
INCLUSION_VALUES = ("weight_pa", "x_m", "y_m", "z_m", "radius_m")


class About(Table):
    """`[study]`: the experiment's name and its scan.

    `travel_from` says from where the scan counts the travel of a press: from its own first touch,
    or from where the surface was planned; without it both are possible. `units_checked` says that
    sizes which look like millimetres or grams are meant literally.
    """

    name: str = Field(min_length=1, description="a name for the study, as text")
    scan: File = Field(description="the scan's file (.csv or .parquet), relative to this file")
    travel_from: Literal["touch", "plane"] | None = None
    units_checked: bool = Field(False, strict=True)
    schema_version: int = Field(SCHEMA, alias="schema", ge=1, strict=True)


class Probe(Table):
    """`[probe]`: the tip that presses."""

    tip: Literal["flat", "sphere", "cone", "ring", "several"] = Field(
        description="'flat' or 'sphere'; scans by other tips of the virtual robot say 'cone', "
        "'ring' or 'several', which no fit takes"
    )
    radius_m: Positive = Field(description="the tip's radius in m")
    most_force_n: Positive | None = Field(
        None,
        description="largest force in N of the presses that are proposed; None is that of the scan",
    )

    @classmethod
    def made_from(cls, found: object) -> str:
        """Return how one is made, for a sentence about another thing found in its place."""
        return "pm.FlatTip(0.005) or pm.Sphere(0.005)"


class Noise(Table):
    """`[noise]`: one standard deviation of each reading; None is estimated from the scan.

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.Noise(displacement_m=2e-5).force_n is None
    True
    """

    displacement_m: Positive | None = None
    force_n: Positive | None = None
    touch_m: Positive | None = None
    lag_s: Annotated[Real, Field(gt=0, le=0.5)] | None = None

    def with_touch(self, errors_m: Sequence[float]) -> "Noise":
        """Return the noise with the rms of the presses' errors of first touch (j,), m.

        One below half of the noise of a reading is left out.

        >>> noise = Noise(displacement_m=2e-5)
        >>> noise.with_touch([3e-5, 4e-5]).touch_m, noise.with_touch([1e-6, 2e-6]).touch_m
        (3.5e-05, None)
        """
        touch_m = (sum(error**2 for error in errors_m) / max(len(errors_m), 1)) ** 0.5
        if touch_m < (self.displacement_m or 0.0) / 2 or not touch_m:
            return self
        return self.model_copy(update={"touch_m": float(f"{touch_m:.2g}")})


class Map(Table):
    """`[map]`: its kind; of inclusions their number, first guesses and fixed values by name.

    Names are `background_pa` and `inclusion_1.weight_pa`, `.x_m`, `.y_m`, `.z_m`, `.radius_m`;
    positions are in the scan's frame. A "free" map has any shape: the logarithm of the modulus is a
    Gaussian field, whose prior is found from the scan or given: `length_m`, the distance over which
    it changes, and `spread`, the standard deviation of the logarithm. A `smoothness` of 1.5 is for
    a body that changes gradually everywhere, in place of 0.5. Of a free map each
    region of a label volume (`regions`, a file in the scan's frame, in units of `regions_unit_m`)
    has a level of its own. "auto" takes the kind for which the scan gives more evidence.
    """

    kind: Literal["inclusions", "free", "auto"] = "inclusions"
    length_m: Positive | None = None
    spread: Annotated[Positive, Field(le=4)] | None = None
    smoothness: float | None = None
    regions: File | None = None
    regions_unit_m: Positive | None = None
    inclusions: int | Literal["auto"] = 1
    initial: dict[str, float] = Field(default_factory=dict)
    fixed: dict[str, float] = Field(default_factory=dict)

    @field_validator("inclusions", mode="before")
    @classmethod
    def _number_or_auto(cls, value: Any) -> Any:
        if value == "auto" or (type(value) is int and 0 <= value <= MOST_INCLUSIONS):
            return value
        raise ValueError(f'a whole number from 0 to {MOST_INCLUSIONS}, or "auto"')

    @field_validator("smoothness", mode="before")
    @classmethod
    def _one_of_two(cls, value: Any) -> Any:
        if value is None or (type(value) is float and value in (0.5, 1.5)):
            return value
        raise ValueError("0.5, for a body of any kind, or 1.5, for one that changes gradually")

    @field_validator("initial", "fixed", mode="before")
    @classmethod
    def _flatten(cls, value: Any) -> Any:
        """`inclusion_1.x_m = 1` without quotation marks is a table in TOML; both are read."""
        if not isinstance(value, dict):
            raise ValueError("a table of parameter names and numbers")
        flat = {}
        for key, entry in value.items():
            inner = entry.items() if isinstance(entry, dict) else [("", entry)]
            flat |= {f"{key}.{name}" if name else key: number for name, number in inner}
        for name, number in flat.items():
            said = f"for '{name}', not {shortened(number)}"
            if type(number) not in (int, float) or number != number or abs(number) == inf:
                raise ValueError(f"a number {said}")
            if abs(number) > LARGEST_NUMBER:
                raise ValueError(f"a size up to {LARGEST_NUMBER:g} {said}")
            if name.endswith(("background_pa", "radius_m")) and number <= 0:
                raise ValueError(f"a number greater than 0 {said}")
        return flat

    @model_validator(mode="after")
    def _kind_has_its_keys(self) -> "Map":
        free = self.kind != "inclusions"
        field = ("length_m", "spread", "smoothness", "regions", "regions_unit_m")
        of_others = ("inclusions", "initial", "fixed") if free else field
        for key in of_others:
            if key in self.model_fields_set and getattr(self, key) not in ({}, None):
                says = "which takes no inclusions' values" if free else 'not "free"'
                raise ValueError(f"no key '{key}', as kind is \"{self.kind}\", {says}; remove one")
        return self

    @model_validator(mode="after")
    def _names_exist(self) -> "Map":
        count = 9 if self.inclusions == "auto" else self.inclusions
        known = ["background_pa"] + [
            f"inclusion_{i}.{value}" for i in range(1, count + 1) for value in INCLUSION_VALUES
        ]
        for name in [*self.initial, *self.fixed]:
            if name not in known:
                near = nearest(name, tuple(known))
                number = f"{self.inclusions} inclusion{'' if self.inclusions == 1 else 's'}"
                raise ValueError(f"parameters of {number}; '{name}' is none{near}")
        both = self.initial.keys() & self.fixed.keys()
        if both:
            raise ValueError(f"'{min(both)}' in [map.initial] or [map.fixed], not in both")
        given = {**self.initial, **self.fixed}
        background = given.get("background_pa", inf)
        for name, value in given.items():
            if name.endswith("weight_pa") and value <= -background:
                raise ValueError(
                    f"'{name}' above minus the background, {-background:g} Pa, so that the "
                    f"modulus stays positive, not {value:g} Pa"
                )
        return self


class Uncertainty(Table):
    """`[uncertainty]`: number of samples that `fit` draws from the posterior of map and effects."""

    samples: int = 0

    @field_validator("samples", mode="before")
    @classmethod
    def _none_or_enough(cls, value: Any) -> Any:
        if type(value) is int and (value == 0 or LEAST_SAMPLES <= value <= MOST_SAMPLES):
            return value
        raise ValueError(f"a whole number from {LEAST_SAMPLES} to {MOST_SAMPLES}, or 0 for none")


class Effect(Table):
    """One entry of `[[effects]]`: an effect that the model has.

    `name` is one of the catalogue's, or with `file` (Python code, which is executed) the user's
    own; `initial` are values to start from, by parameter.
    """

    name: str = Field(min_length=1, description="the effect's name")
    file: File | None = None
    initial: dict[str, Real] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _is_known(self) -> "Effect":
        if self.file is not None:
            return self
        from identify.catalogue import CATALOGUE  # here, as most studies name no effect
        from identify.effects import lacking_in

        names = tuple(effect.name for effect in CATALOGUE)
        if self.name not in names:
            raise ValueError(
                "an effect of the catalogue (`palpmap effects` lists them), or with file = ... one "
                f"of your own, not '{self.name}'{nearest(self.name, names)}"
            )
        if lacking := lacking_in(CATALOGUE[self.name], self.initial):
            raise ValueError(lacking)
        return self


class Study(Table):
    """A study file; paths are absolute after `load_study`.

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.read_study("tests/data/twelve_presses/study.toml").study.probe.tip
    'flat'
    """

    study: About = Field(description="the table [study] with name and scan")
    body: Body = Field(description="the table [body]")
    probe: Probe = Field(description="the table [probe]")
    noise: Noise = Field(default_factory=Noise)
    map: Map = Field(default_factory=Map)
    uncertainty: Uncertainty = Field(default_factory=Uncertainty)
    effects: tuple[Effect, ...] = ()

    @field_validator("effects")
    @classmethod
    def _each_once(cls, value: tuple[Effect, ...]) -> tuple[Effect, ...]:
        names = [effect.name for effect in value]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise ValueError(f"each effect once, but '{twice[0]}' is named twice; remove one")
        return value

    @property
    def name(self) -> str:
        """The study's name."""
        return self.study.name

    @property
    def scan(self) -> Path:
        """Path of the scan."""
        return self.study.scan


def load_study(path: str | os.PathLike[str], *, scanned: bool = True) -> Study:
    """Read and check a study file; relative paths in it start at its folder.

    Parameters
    ----------
    scanned : False for a body that is yet to be scanned: `study.scan` may be missing, and is then
        scan.csv

    Raises
    ------
    InputError
        Naming file, TOML key, what was found and what is expected; for text that is not TOML,
        the line.
    """
    path = Path(path)
    tables = study_tables(path)
    about = tables.get("study")
    if isinstance(about, dict) and not scanned:
        about.setdefault("scan", "scan.csv")
    schema = about.get("schema", SCHEMA) if isinstance(about, dict) else SCHEMA
    if isinstance(schema, int) and schema > SCHEMA:
        raise InputError(
            f"{path}, key study.schema: found {schema}, expected at most {SCHEMA}; update palpmap"
        )
    try:
        study = Study.model_validate(tables)
    except ValidationError as error:
        raise InputError(fault_sentence(path, error, Study)) from error
    except RecursionError as error:
        raise InputError(
            f"{path}: found tables nested too deep, expected those of a study; correct it"
        ) from error
    if not study.study.units_checked:
        check_units(path, study)
    folder = path.resolve().parent
    body = study.body
    if body.file is not None:
        body = body.model_copy(update={"file": folder / body.file})
    elif body.shape == "from-contacts":
        body = body.model_copy(update={"file": folder / study.study.scan})
    about = study.study.model_copy(update={"scan": folder / study.study.scan})
    study_map = study.map
    if study_map.regions is not None:
        study_map = study_map.model_copy(update={"regions": folder / study_map.regions})
    effects = tuple(
        entry if entry.file is None else entry.model_copy(update={"file": folder / entry.file})
        for entry in study.effects
    )
    return study.model_copy(
        update={"study": about, "body": body, "map": study_map, "effects": effects}
    )


def write_study(study: Study, path: str | os.PathLike[str]) -> None:
    """Write a study file that `load_study` reads; paths inside its folder are written relative."""
    import tomli_w

    folder = Path(path).resolve().parent

    def relative(file: Path) -> str:
        inside = file.is_absolute() and file.is_relative_to(folder)
        return (file.relative_to(folder) if inside else file).as_posix()

    tables = study.model_dump(by_alias=True, exclude_defaults=True)
    tables["study"] |= {"scan": relative(study.scan), "schema": SCHEMA}
    tables["body"]["support"] = study.body.support
    if study.body.file is not None:
        tables["body"]["file"] = relative(study.body.file)
        if study.body.shape == "from-contacts" and study.body.file == study.scan:
            del tables["body"]["file"]
    if study.map.regions is not None:
        tables["map"]["regions"] = relative(study.map.regions)
    for table, entry in zip(tables.get("effects", ()), study.effects, strict=False):
        if entry.file is not None:
            table["file"] = relative(entry.file)
    if study.map.kind == "inclusions":
        tables.setdefault("map", {})["inclusions"] = study.map.inclusions
    with replaced(path) as beside:
        beside.write_text(tomli_w.dumps(tables), encoding="utf-8")
