"""Fits against other scans and other fits, for the Python door: they show and write themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from identify.residual import Prediction as PredictionOfScan
from identify.residual import RunDifference
from models import kinds_checked, replaced
from palpmap.experiment import Experiment
from palpmap.record import FileRecord, Record
from palpmap.results import FitResult, Shown, drawn, values_of
from palpmap.run_folder import RunFolder, how_made

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import RenderableType


class PredictedPressRecord(Record):
    """A press of a prediction, near its largest forces."""

    press: int
    error_m: float = Field(description="measured less predicted travel, m")
    sd_m: float = Field(description="standard deviation of the band, m")
    force_error_share: float = Field(
        description="error of the travel as a force, over the largest; positive of a softer body"
    )


class PredictionRecord(FileRecord):
    """prediction.json: a scan predicted by a fit that has not seen it."""

    verdict: Literal["calibrated", "too narrow", "too wide"] = Field(description="of the bands")
    statement: str
    chi2_per_press: float = Field(description="chi-square of the presses' errors, per press")
    p_value: float = Field(description="probability of errors this large, were the bands right")
    within95: float = Field(description="share of the presses in their 95 % bands")
    band_over_error: float | None = Field(
        None, description="width of the bands over what the errors ask for; null in older files"
    )
    force_error_median: float = Field(description="of the largest force, median over the presses")
    force_error_90: float = Field(description="of the largest force, 90 % of the presses below")
    error_rms_m: float = Field(description="of the travel near the largest forces, rms, m")
    band_parts_m: Mapping[str, float] = Field(
        description="standard deviation of a reading's travel there by cause, rms, m"
    )
    notes: tuple[str, ...] = Field(description="sentences about scan and body")
    presses: tuple[PredictedPressRecord, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Shown, PredictionOfScan):
    """A scan predicted by a fit that has not seen it, with bands.

    Its fields are those of `identify.residual.prediction.Prediction`: `predicted_m`, `sd_m`,
    `residual_m`, `press_error_m`, `press_sd_m`, `chi2`, `verdict`, `within95`,
    `band_over_error`.

    Attributes
    ----------
    fit : that predicts
    experiment : scan and study that are predicted
    notes : sentences about scan and body

    Examples
    --------
    >>> import palpmap as pm
    >>> fit = pm.read_run("tests/data/twelve_presses").fit
    >>> found = pm.predict(fit, fit.experiment)
    >>> found.presses, found.residual_m.shape
    (12, (264,))
    """

    fit: FitResult = field(kw_only=True)
    experiment: Experiment = field(kw_only=True)
    notes: tuple[str, ...] = field(default=(), kw_only=True)

    @classmethod
    def of(
        cls,
        found: PredictionOfScan,
        fit: FitResult,
        experiment: Experiment,
        notes: tuple[str, ...],
    ) -> Prediction:
        """Return a record of `identify` with its fit and its scan."""
        return cls(**values_of(found), fit=fit, experiment=experiment, notes=notes)

    def __repr__(self) -> str:
        return f"Prediction({self.experiment.study.name!r}, {self.verdict!r})"

    @property
    def holds(self) -> bool:
        """False where the errors are larger than the bands say."""
        return self.verdict != "too narrow"

    @property
    def statement(self) -> str:
        """The outcome in two sentences."""
        from palpmap.report.prediction_report import statement_of

        return statement_of(self)

    @property
    def _origin_m(self) -> np.ndarray:
        return np.array(self.experiment.study.body.origin_m)

    def _renderables(self) -> Sequence[RenderableType]:
        from palpmap.report.prediction_report import prediction_summary

        return [*prediction_summary(self, self._origin_m), *(f"- {note}" for note in self.notes)]

    def _picture(self) -> Figure:
        return self.plot()

    def plot(self) -> Figure:
        """Draw measured against predicted travel, and single presses with their bands."""
        from palpmap.figures.prediction import draw_prediction

        return drawn(draw_prediction, self)

    @property
    def record(self) -> PredictionRecord:
        """Content of prediction.json."""
        share, near = self.force_error_share, self.scan.near_largest_force

        def rms(values: np.ndarray) -> float:
            return float(np.sqrt(np.mean(values**2)))

        rows = zip(
            self.scan.press_ids.tolist(), self.press_error_m.tolist(), self.press_sd_m.tolist(),
            share.tolist(), strict=True,
        )  # fmt: skip
        return PredictionRecord(
            verdict=self.verdict,
            statement=self.statement,
            chi2_per_press=self.chi2 / self.presses,
            p_value=self.p_too_narrow,
            within95=self.within95,
            band_over_error=self.band_over_error,
            force_error_median=float(np.median(np.abs(share))),
            force_error_90=float(np.quantile(np.abs(share), 0.9)),
            error_rms_m=rms(self.press_error_m),
            band_parts_m={name: rms(sd[near]) for name, sd in self.parts_m.items()},
            notes=self.notes,
            presses=tuple(
                PredictedPressRecord(press=j, error_m=e, sd_m=s, force_error_share=f)
                for j, e, s, f in rows
            ),
        )

    def to_dict(self) -> dict[str, object]:
        """Return the prediction as plain data, as prediction.json holds it."""
        return dict(self.record.to_dict())

    @kinds_checked
    def write(self, folder: str | Path) -> Path:
        """Write a run folder: prediction.json, prediction.csv, the picture, report.html."""
        inputs = [*self.fit.experiment.inputs, *self.experiment.inputs]
        with RunFolder("predict", Path(folder), inputs=inputs) as run:
            self.write_files(run.path)
            return run.path

    def write_files(self, folder: Path) -> None:
        """Write the files into a folder that is there."""
        from palpmap.figures.fit import save_figures
        from palpmap.figures.style import png
        from palpmap.report.prediction_report import write_prediction_report

        self.record.write(folder / "prediction.json")
        scan = self.scan
        columns = (
            scan.press, scan.force_n, scan.displacement_m, self.predicted_m, self.sd_m, self.error_n
        )  # fmt: skip
        with replaced(folder / "prediction.csv") as beside:
            np.savetxt(
                beside, np.column_stack(columns), delimiter=",", comments="",
                fmt=("%d", *["%.9g"] * 5),
                header="press,force_n,displacement_m,predicted_m,sd_m,error_n",
            )  # fmt: skip
        pictures = {"prediction": png(self.plot())}
        save_figures(pictures, folder)
        write_prediction_report(
            self, folder / "report.html", name=self.fit.experiment.study.name,
            other=self.experiment.study.name, origin_m=self._origin_m, notes=self.notes,
            pictures=pictures, how=how_made(folder),
        )  # fmt: skip


class ChangeRecord(Record):
    """A parameter of two fits."""

    name: str
    unit: str
    one: float | None = Field(description="in the one fit; null if it is not in it")
    other: float | None = Field(description="in the other fit; null if it is not in it")
    standard_errors: float | None = Field(description="difference over its standard error")


class DifferenceRecord(FileRecord):
    """difference.json: two runs on one body."""

    maps_differ: bool
    bodies_differ: bool | None = Field(
        None, description="maps, or effects beside them, differ; null in older files"
    )
    in_maps: tuple[str, ...] = Field((), description="effects that change the compared maps")
    beside_maps: tuple[str, ...] = Field(
        (), description="effects that change the stiffness beside the maps, and differ"
    )
    statement: str
    p_value: float = Field(description="of the largest difference, were the maps the same")
    place_m: tuple[float, float, float] = Field(description="of it, in the scan's frame, m")
    ratio: float = Field(description="other modulus over the one, there")
    standard_errors: float = Field(description="difference of ln E over its standard error, there")
    changes: tuple[ChangeRecord, ...] = Field(description="of the parameters")
    notes: tuple[str, ...] = Field((), description="sentences about the two scans")


@dataclass(frozen=True, eq=False, repr=False)
class MapChange(Shown):
    """Difference of two fits of one body, in standard errors.

    Attributes
    ----------
    one, other : the fits
    difference : of maps and effects (`identify.residual.two_runs.RunDifference`)
    notes : sentences about the two scans

    Examples
    --------
    >>> import palpmap as pm
    >>> fit = pm.read_run("tests/data/twelve_presses").fit
    >>> pm.compare_runs(fit, fit).maps_differ
    False
    """

    one: FitResult
    other: FitResult
    difference: RunDifference
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"MapChange({self.maps_differ})"

    @property
    def maps_differ(self) -> bool:
        """True if the maps differ by more than their errors."""
        return self.difference.maps_differ

    @property
    def bodies_differ(self) -> bool:
        """True if the maps differ, or an effect that changes the stiffness beside them."""
        return self.difference.bodies_differ

    @property
    def _origin_m(self) -> np.ndarray:
        return np.array(self.one.experiment.study.body.origin_m)

    def _renderables(self) -> Sequence[RenderableType]:
        from palpmap.report.difference_report import difference_summary

        said = difference_summary(self.difference, self._origin_m)
        return [*said, *(f"- {note}" for note in self.notes)]

    def _picture(self) -> Figure:
        return self.plot()

    def plot(self) -> Figure:
        """Draw the ratio of the maps and their difference in standard errors."""
        from palpmap.figures.run_difference import draw_difference

        return drawn(draw_difference, self.difference, self._origin_m)

    @property
    def record(self) -> DifferenceRecord:
        """Content of difference.json."""
        from palpmap.report.difference_report import statement_of

        d, at = self.difference, self.difference.largest
        x, y, z = (d.grid.points_m[at] + self._origin_m).tolist()
        return DifferenceRecord(
            maps_differ=d.maps_differ,
            bodies_differ=d.bodies_differ,
            in_maps=d.in_maps,
            beside_maps=d.beside_maps,
            statement=statement_of(d, self._origin_m),
            p_value=d.p_value,
            place_m=(x, y, z),
            ratio=float(np.exp(d.log_ratio[at])),
            standard_errors=float(d.standard_errors[at]),
            changes=tuple(map(ChangeRecord.copy_of, d.changes)),
            notes=self.notes,
        )

    def to_dict(self) -> dict[str, object]:
        """Return the difference as plain data, as difference.json holds it."""
        return dict(self.record.to_dict())

    @kinds_checked
    def write(self, folder: str | Path) -> Path:
        """Write a run folder: difference.json, the picture, report.html."""
        inputs = dict.fromkeys([*self.one.experiment.inputs, *self.other.experiment.inputs])
        with RunFolder("compare", Path(folder), inputs=list(inputs)) as run:
            self.write_files(run.path)
            return run.path

    def write_files(self, folder: Path) -> None:
        """Write difference.json, the picture and report.html into a folder that is there."""
        from palpmap.figures.fit import save_figures
        from palpmap.figures.style import png
        from palpmap.report.difference_report import write_difference_report

        self.record.write(folder / "difference.json")
        pictures = {"difference": png(self.plot())}
        save_figures(pictures, folder)
        names = [fit.experiment.study.name for fit in (self.one, self.other)]
        write_difference_report(
            self.difference, folder / "report.html", names=names, origin_m=self._origin_m,
            notes=self.notes, pictures=pictures, how=how_made(folder),
        )  # fmt: skip
