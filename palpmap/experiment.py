"""An experiment: a scan with its body, tip and noise, for the Python door."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from identify import PlacedExperiment, Progress, silent
from identify.effects import Effect
from identify.measurement import Noise as ScanNoise
from models import InputError, Scan, check_scan, kinds_checked, path_or, read_scan
from palpmap.study import study as study_file
from palpmap.study.body import Body
from palpmap.study.faults import naming_study
from palpmap.study.open_study import catalogue_with, most_presses, open_study, own_effects
from palpmap.study.study import About, Map, Probe, Study, Uncertainty, load_study
from palpmap.study.units_check import check_units

Support = Literal["base-bonded", "base-sliding", "base-elastic"]
_NOWHERE = Path("(in memory)") / "scan.csv"


@dataclass(frozen=True, init=False, eq=False)
class Experiment:
    """A measured scan, with its body, tip, noise and supports.

    Parameters
    ----------
    scan : the measured table, in its own frame
    body : `Block`, or a `Body` from a closed surface
    tip : `FlatTip` or `Sphere`
    noise : standard deviations of both readings; missing ones are estimated from the scan
    name : title of reports
    units_checked : values that look like millimetres or grams are meant as they are

    Attributes
    ----------
    study : the same as the tables of a study file
    source : the study file, None where the experiment was made in Python

    Raises
    ------
    InputError
        A value is impossible, or looks like one in another unit: which one, what was found and
        what is expected.

    Examples
    --------
    >>> import palpmap as pm
    >>> study = pm.read_study("tests/data/lab/case_a/study.toml")
    >>> again = pm.Experiment(
    ...     study.scan, pm.Block((0.096, 0.096, 0.048), poisson_ratio=0.49), pm.FlatTip(0.005)
    ... )
    >>> len(again.scan.press_ids)
    81
    """

    scan: Scan = field(repr=False)
    study: Study
    source: Path | None
    _open: dict[bool, PlacedExperiment] = field(repr=False)

    @kinds_checked
    def __init__(
        self,
        scan: Scan,
        body: Body,
        tip: Probe,
        *,
        noise: study_file.Noise | None = None,
        name: str = "experiment",
        units_checked: bool = False,
    ) -> None:
        about = About(name=name, scan=_NOWHERE, units_checked=units_checked)
        study = Study(study=about, body=body, probe=tip, noise=noise or study_file.Noise())
        check_scan(scan, "scan", units_checked)
        if not units_checked:
            check_units(None, study)
        self._hold(scan, study, None)

    def _hold(self, scan: Scan, study: Study, source: Path | None) -> None:
        for key, value in (("scan", scan), ("study", study), ("source", source), ("_open", {})):
            object.__setattr__(self, key, value)

    @classmethod
    def of(cls, scan: Scan, study: Study, source: Path | None = None) -> Experiment:
        """Return the experiment of a scan and a study that was read."""
        made = cls.__new__(cls)
        made._hold(scan, study, source)
        return made

    @classmethod
    def made_from(cls, found: object) -> str:
        """Return how one is made, for a sentence about another thing found in its place."""
        return f"pm.read_study({path_or(found, 'path')})"

    @property
    def inputs(self) -> list[Path]:
        """Files that the experiment was read from."""
        return [] if self.source is None else [self.source, self.study.scan]

    @cached_property
    def own_effects(self) -> tuple[Effect, ...]:
        """Effects of the user that the study names; their files are executed."""
        return tuple(own_effects(self.study))

    @kinds_checked
    def with_inclusions(self, inclusions: int | Literal["auto"] | None) -> Experiment:
        """Return the experiment with another number of inclusions in its map; None keeps it."""
        if inclusions is None:
            return self
        if (kind := self.study.map.kind) != "inclusions":
            raise InputError(
                f'study, key map.kind: found "{kind}", which takes no number of inclusions; leave '
                'it out or set kind = "inclusions"'
            )
        if isinstance(inclusions, np.integer):
            inclusions = int(inclusions)
        map_table = self.study.map.model_copy(update={"inclusions": inclusions})
        checked = Map(**map_table.model_dump(warnings=False))
        study = self.study.model_copy(update={"map": checked})
        return Experiment.of(self.scan, study, self.source)

    @kinds_checked
    def with_samples(self, samples: int | None) -> Experiment:
        """Return the experiment with another number of posterior samples; None keeps it."""
        if samples is None:
            return self
        asked = Uncertainty(samples=samples)
        study = self.study.model_copy(update={"uncertainty": asked})
        return Experiment.of(self.scan, study, self.source)

    @kinds_checked
    def of_kind(
        self, kind: Literal["inclusions", "free"], smoothness: float | None = None
    ) -> Experiment:
        """Return the experiment with another kind of map, inclusions of a number to be found.

        `smoothness` of a free map is 0.5, or 1.5 for a body that changes gradually; None is the
        study's.
        """
        number = "auto" if kind == "inclusions" else 1
        study_map = self.study.map
        table = Map(kind=kind, inclusions=number) if kind == "inclusions" else Map(
            kind=kind, length_m=study_map.length_m, spread=study_map.spread,
            smoothness=study_map.smoothness if smoothness is None else smoothness,
            regions=study_map.regions,
            regions_unit_m=study_map.regions_unit_m,
        )  # fmt: skip
        study = self.study.model_copy(update={"map": table})
        return Experiment.of(self.scan, study, self.source)

    @kinds_checked
    def of_presses(self, ids: Collection[int]) -> Experiment:
        """Return the experiment with some of its presses, by their ids."""
        kept = np.isin(self.scan.press, np.array([*ids]))
        return Experiment.of(self.scan.rows(kept), self.study, self.source)

    @kinds_checked
    def opened(
        self, say: Progress = silent, thin: bool = True, noise: ScanNoise | None = None
    ) -> PlacedExperiment:
        """Return the placed scan with the models of the body; meshed once.

        Parameters
        ----------
        say : progress of what is made of it
        thin : use no more presses than the selection needs (`models.thin`)
        noise : where it is known; else the study's, or estimated

        Raises
        ------
        InputError
            Scan and study do not fit together.
        """
        thin = thin and len(self.scan.press_ids) > most_presses(self.study)
        if thin not in self._open:
            catalogue = catalogue_with(self.own_effects)
            with naming_study(self.source):
                self._open[thin] = open_study(self.study, self.scan, catalogue, thin, say, noise)
        return replace(self._open[thin], say=say)


@kinds_checked
def read_study(path: str | Path) -> Experiment:
    """Read a study file and its scan.

    Raises
    ------
    InputError
        Naming file, key or row and column, what was found and what is expected.

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.read_study("tests/data/lab/case_a/study.toml").study.body.poisson_ratio
    0.49
    """
    study = load_study(path)
    return Experiment.of(read_scan(study.scan, study.study.units_checked), study, Path(path))


def Block(
    size_m: Sequence[float],
    *,
    poisson_ratio: float,
    origin_m: Sequence[float] = (0.0, 0.0, 0.0),
    support: Support = "base-bonded",
    cell_size_m: float | None = None,
) -> Body:
    """Return a block: x and y in [0, size], z up from its base.

    Parameters
    ----------
    size_m : (3,) edges, m
    poisson_ratio : 0 to 0.4999
    origin_m : (3,) place of the block's corner in the scan's frame, m
    support : of the base
    cell_size_m : size of the finite elements; None takes the default

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.Block((0.096, 0.096, 0.048), poisson_ratio=0.49).support
    'base-bonded'
    """
    return Body(
        shape="block",
        size_m=size_m,
        poisson_ratio=poisson_ratio,
        origin_m=origin_m,
        support=support,
        cell_size_m=cell_size_m,
    )


def FlatTip(radius_m: float, *, most_force_n: float | None = None) -> Probe:
    """Return a flat, round tip.

    Parameters
    ----------
    radius_m : m
    most_force_n : largest force of the presses that are proposed; None is that of the scan

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.FlatTip(0.005).radius_m
    0.005
    """
    return Probe(tip="flat", radius_m=radius_m, most_force_n=most_force_n)


def Sphere(radius_m: float, *, most_force_n: float | None = None) -> Probe:
    """Return a ball-shaped tip.

    Parameters
    ----------
    radius_m, most_force_n : see `FlatTip`

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.Sphere(0.004).tip
    'sphere'
    """
    return Probe(tip="sphere", radius_m=radius_m, most_force_n=most_force_n)


def Noise(
    displacement_m: float | None = None,
    force_n: float | None = None,
    touch_m: float | None = None,
    lag_s: float | None = None,
) -> study_file.Noise:
    """Return the noise of a scan, one standard deviation each; None is estimated from the scan.

    Parameters
    ----------
    displacement_m, force_n : of each reading, m and N
    touch_m, lag_s : of errors that the readings of a press, or all of them, share: the depth of
        first touch, and the lag between force and displacement; None is no such error

    Examples
    --------
    >>> import palpmap as pm
    >>> pm.Noise(displacement_m=2e-5).force_n is None
    True
    """
    return study_file.Noise(
        displacement_m=displacement_m,
        force_n=force_n,
        touch_m=touch_m,
        lag_s=lag_s,
    )
