"""Results of the Python door: each is a record of `identify` that shows and writes itself.

`summary()` is text, `plot_...()` a matplotlib figure, `to_dict()` the content of the JSON file.
Lengths are in m, forces in N, moduli in Pa.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from identify import Progress, silent
from identify.fit import FitResult as FitRecord
from identify.fit import draw_posterior, refuse_samples
from identify.residual import Comparison as ComparisonRecord
from identify.residual import ResidualTest
from models import Seed, kinds_checked, path_or
from palpmap.experiment import Experiment
from palpmap.run_folder import RunFolder
from palpmap.study.study import Uncertainty

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console, RenderableType

    from palpmap.result.finding import Finding
    from palpmap.result.records import ExplainRecord


_SAID = 50  # draws between two words of progress


class Shown(ABC):
    """A result that shows itself as text, and in a notebook."""

    @abstractmethod
    def _renderables(self) -> Sequence[RenderableType]:
        """Tables and sentences of the result."""

    def renderables(self) -> Sequence[RenderableType]:
        """Return tables and sentences for a rich console."""
        return self._renderables()

    def _picture(self) -> Figure | None:
        """Return the picture of a notebook."""
        return None

    def summary(self) -> str:
        """Return the result as text, 100 columns wide."""
        lines = _printed(self._renderables()).export_text().splitlines()
        return "\n".join(line.rstrip() for line in lines).rstrip() + "\n"

    def _repr_html_(self) -> str:
        from base64 import b64encode

        from palpmap.figures.style import png

        text = _printed(self._renderables()).export_html(
            code_format="<pre style='line-height: 1.2'>{code}</pre>", inline_styles=True
        )
        figure = self._picture()
        if figure is None:
            return text
        picture = b64encode(png(figure)).decode()
        return f'{text}<img src="data:image/png;base64,{picture}" style="max-width: 100%">'


def _printed(renderables: Sequence[RenderableType]) -> Console:
    from rich.console import Console

    console = Console(file=StringIO(), width=100, highlight=False, record=True, force_jupyter=False)
    for renderable in renderables:
        console.print(renderable)
    return console


def drawn(draw: Any, *given: Any) -> Figure:
    """Draw a figure in the style of reports."""
    from matplotlib import rc_context

    from palpmap.figures.style import STYLE

    with rc_context(STYLE):
        return draw(*given)


def values_of(record: Any) -> dict[str, Any]:
    """Return the fields of a dataclass, unchanged."""
    return {entry.name: getattr(record, entry.name) for entry in fields(record)}


@dataclass(frozen=True, eq=False, repr=False)
class FitResult(Shown, FitRecord):
    """A fitted map, with the effects of the study beside it; positions in the body's frame.

    Its fields are those of `identify.fit.result.FitResult`: `map`, `parameters` (value, standard
    deviation, 95 % interval and unit by name), `covariance`, `residual_m`, `success`, `message`.

    Attributes
    ----------
    experiment : scan and study of the fit
    note : simplification of the body's model, or nothing

    Examples
    --------
    >>> import palpmap as pm
    >>> print(pm.read_run("tests/data/twelve_presses").fit.summary()[:25])
    The residual is not noise
    """

    experiment: Experiment = field(kw_only=True)
    note: str = field(default="", kw_only=True)

    @classmethod
    def of(cls, found: FitRecord, experiment: Experiment, note: str = "") -> Self:
        """Return a record of `identify` with its experiment."""
        return cls(**values_of(found), experiment=experiment, note=note)

    @classmethod
    def made_from(cls, found: object) -> str:
        """Return how one is made, for a sentence about another thing found in its place."""
        if isinstance(found, Experiment):
            return "pm.fit(experiment)"
        folder = found.folder if isinstance(found, Run) else found
        read = f"pm.read_run({path_or(folder, 'folder')}).fit"
        return read if isinstance(folder, str | Path) else f"pm.fit(experiment), or {read}"

    def __repr__(self) -> str:
        return f"FitResult({self.experiment.study.name!r}, {self.message!r})"

    @kinds_checked
    def sample(self, samples: int = 4000, seed: Seed = 0, progress: Progress = silent) -> Self:
        """Return the fit with draws from the posterior of map and effects.

        Parameters
        ----------
        samples : number of draws, 1000 or more; 0 for none
        seed : of the random numbers
        progress : called with the number of draws so far, in words

        Raises
        ------
        InputError
            The posterior cannot be drawn: why.
        """
        refuse_samples(self)
        if not Uncertainty(samples=samples).samples:
            return replace(self, posterior=None)

        def say(drawn: int) -> None:
            if drawn % _SAID == 0 or drawn == samples:
                progress(f"drawing {drawn} of {samples} samples")

        return replace(self, posterior=draw_posterior(self._live, samples, seed, say))

    @cached_property
    def finding(self) -> Finding:
        """The fit with its comparison, as figures and report show it."""
        from palpmap.run_files.fit_run import finding_of

        return finding_of(self, self.experiment.study, self.experiment.scan, self.note)

    def _renderables(self) -> Sequence[RenderableType]:
        from palpmap.report.fit_console import summary

        return summary(self.finding)

    def _picture(self) -> Figure:
        return self.plot_map()

    def plot_map(self) -> Figure:
        """Draw the map of Young's modulus, from above and from the side."""
        from palpmap.figures.map import draw_map

        return drawn(draw_map, self.finding)

    def plot_residual(self) -> Figure:
        """Draw the residual over the places of the presses."""
        from palpmap.figures.residual import draw_places

        return drawn(draw_places, self.finding)

    def to_dict(self) -> dict[str, object]:
        """Return the fit as plain data, as `palpmap fit --json` prints it."""
        comparison = self.finding.comparison
        return {
            "schema": 1,
            "success": self.success,
            "message": self.message,
            "parameters": {name: vars(estimate) for name, estimate in self.parameters.items()},
            "chi2_per_dof": self.chi2_per_dof,
            "rms_m": self.rms_m,
            "noise": vars(self.noise),
            "evaluations": self.nfev,
            "residual": comparison.statement,
            "residual_is_noise": comparison.is_noise,
            "posterior": None if self.posterior is None else self.posterior.to_dict(),
        }

    @kinds_checked
    def write(self, folder: str | Path) -> Path:
        """Write the run folder of `palpmap fit`: fit, comparison, figures, report, recording."""
        from palpmap.run_files.fit_run import FitRun

        known = self.experiment
        settings = {"inclusions": known.study.map.inclusions}
        with (
            RunFolder("fit", Path(folder), settings=settings, inputs=known.inputs) as run,
            FitRun(run.path, known) as fit_run,
        ):
            for step in self.history:
                fit_run.record(step)
            fit_run.finish(self.finding)
            return run.path


@dataclass(frozen=True, eq=False)
class Comparison(Shown):
    """Residual of a fit: tests for structure along place, force, time and order.

    Attributes
    ----------
    fit : of the residual
    record : tests, presses and statement (`identify.residual.comparison.Comparison`)

    Examples
    --------
    >>> import palpmap as pm
    >>> comparison = pm.compare(pm.read_run("tests/data/twelve_presses").fit)
    >>> comparison.is_noise, len(comparison.tests)
    (False, 12)
    """

    fit: FitResult
    record: ComparisonRecord = field(repr=False)

    @property
    def is_noise(self) -> bool:
        """True where the residual is consistent with noise."""
        return self.record.is_noise

    @property
    def tests(self) -> tuple[ResidualTest, ...]:
        """Tests of the residual with their p-values."""
        return self.record.tests

    @property
    def statement(self) -> str:
        """The result in one sentence or two."""
        return self.record.statement

    def _renderables(self) -> Sequence[RenderableType]:
        return self.fit.renderables()

    def _picture(self) -> Figure:
        return self.plot()

    def plot(self) -> Figure:
        """Draw the residual along all that was tested."""
        from palpmap.figures.residual import draw_along

        return drawn(draw_along, self.fit.finding)

    @kinds_checked
    def write(self, folder: str | Path) -> Path:
        """Write a run folder: comparison.json, the figures, report.html."""
        from palpmap.run_files.fit_run import write_finding

        with RunFolder("compare", Path(folder), inputs=self.fit.experiment.inputs) as run:
            write_finding(self.fit.finding, run.path)
            return run.path

    def to_dict(self) -> dict[str, object]:
        """Return the comparison as plain data, as comparison.json holds it."""
        return self.record.to_dict()


@dataclass(frozen=True, eq=False)
class Run:
    """A run folder, read back.

    Attributes
    ----------
    folder : its path
    experiment : its study and its scan
    fit : the fitted map, of an explanation the last model's
    result : content of result.json, None of a run without an explanation

    Examples
    --------
    >>> import palpmap as pm
    >>> run = pm.read_run("tests/data/twelve_presses")
    >>> run.experiment.study.name, run.verdict
    ('twelve_presses', None)
    """

    folder: Path
    experiment: Experiment
    fit: FitResult
    result: ExplainRecord | None = field(default=None, repr=False)

    @property
    def verdict(self) -> str | None:
        """The explanation's verdict, None of a run without one."""
        return None if self.result is None else self.result.verdict
