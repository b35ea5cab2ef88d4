"""The Comparison record: analysis of a residual, on disk as JSON."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from identify.residual.courses import Course
from identify.residual.per_press import PressResidual
from identify.residual.simple_laws import LawMatch
from models import replaced

SCHEMA = 1


@dataclass(frozen=True)
class Level:
    """Mean residual `mean_m` +- `error_m` (m) of the readings in one bin.

    `low` and `high` bound the bin in the dimension's unit (N, s, press number), `label` names it.
    """

    label: str
    low: float
    high: float
    mean_m: float
    error_m: float
    readings: int


@dataclass(frozen=True)
class ResidualTest:
    """One question asked of the residual.

    `times_noise` is the pattern's size over that of noise alone; `p_adjusted` is Holm's over all
    questions; `untestable` the reason for no answer from this scan.
    """

    name: str
    question: str
    statistic: float = 0.0
    dof: int = 0
    p_value: float = 1.0
    p_adjusted: float = 1.0
    times_noise: float = 0.0
    fires: bool = False
    untestable: str | None = None


@dataclass(frozen=True)
class Reading:
    """One reading with its residual (m and standard deviations)."""

    press: int
    phase: str
    time_s: float | None
    point_m: tuple[float, float, float]
    force_n: float
    residual_m: float
    sigmas: float


@dataclass(frozen=True)
class Comparison:
    """Analysis of the residual of a fit.

    Attributes
    ----------
    is_noise : bool
        No test has a family-wise p-value below the level asked (`ResidualSettings.structure`).
    varies_with : str or None
        Main direction of the residual: place, force, time, phase, order, press or reading; where a
        test fires at the family-wise level `alpha`.
    statement : str
        The result in one sentence.
    also_along, confused_with : tuple of str
        Further directions beyond `varies_with`; directions that explain the residual as well.
    notes : tuple of str
        Tests that were not possible, with reasons; doubts about the noise given.
    rms_m, expected_rms_m : float
        Of the residual; of noise alone, less the part absorbed by the fitted parameters.
    chi2, dof, chi2_p : float, int, float
        Sum of squared residuals in sigmas, degrees of freedom, p-value.
    scatter : float
        Reading-to-reading scatter in units of the noise given (1 if that is right).
    moran_i, lag1 : float or None
        Moran's I of the presses' levels; correlation of consecutive readings of a press.
    tests, levels, presses, largest :
        All questions; mean residual by force, time, phase, order; per press (by press id);
        the largest single readings.
    law : LawMatch or None
        A simple law for nearly all of the excess chi-square.
    course : Course or None
        A smooth course for most of it.
    frame_m : (3,)
        Origin of the points' frame in that of the scan, of which sentences speak.
    """

    is_noise: bool
    varies_with: str | None
    statement: str
    also_along: tuple[str, ...]
    confused_with: tuple[str, ...]
    notes: tuple[str, ...]
    alpha: float
    readings: int
    parameters: int
    rms_m: float
    expected_rms_m: float
    chi2: float
    dof: int
    chi2_p: float
    noise_estimated: bool
    scatter: float
    moran_i: float | None
    lag1: float | None
    tests: tuple[ResidualTest, ...]
    levels: dict[str, tuple[Level, ...]]
    presses: tuple[PressResidual, ...]
    largest: tuple[Reading, ...]
    law: LawMatch | None = None
    course: Course | None = None
    frame_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def chi2_per_dof(self) -> float:
        """Chi-square per degree of freedom."""
        return self.chi2 / self.dof

    @property
    def p_value(self) -> float:
        """Chance of noise alone to make some test as significant as the most significant (Holm)."""
        return min(test.p_adjusted for test in self.tests)

    @property
    def bad_presses(self) -> tuple[int, ...]:
        """Ids of the outlying presses."""
        return tuple(p.press for p in self.presses if p.bad)

    @property
    def worst_presses(self) -> tuple[PressResidual, ...]:
        """All presses, largest misfit first."""
        return tuple(sorted(self.presses, key=lambda p: -p.misfit))

    def test(self, name: str) -> ResidualTest:
        """Return the question of a name."""
        for test in self.tests:
            if test.name == name:
                return test
        raise KeyError(f"no test '{name}'; there are {', '.join(t.name for t in self.tests)}")

    def to_dict(self) -> dict[str, Any]:
        """Return the record as plain data, with its schema version."""
        return {"schema": SCHEMA, **asdict(self), "chi2_per_dof": self.chi2_per_dof}

    def write(self, path: Path) -> None:
        """Write the record as JSON."""
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False)
        with replaced(path) as beside:
            beside.write_text(text, encoding="utf-8")
