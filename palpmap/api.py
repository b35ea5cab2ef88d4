"""The Python door: fit, compare, diagnose, explain, limits, scan, and runs read back.

    import palpmap as pm

    experiment = pm.read_study("study.toml")
    fit = pm.fit(experiment, inclusions=1)
    comparison = pm.compare(fit)
    why = pm.explain(experiment)
    why.write("runs/why")

Each result holds the record of `identify` (`record`) and shows it: `summary()` as text,
`plot_...()` as a matplotlib figure, `to_dict()` as the JSON file has it. Lengths are in m, forces
in N, moduli in Pa. Progress goes to the callback that the caller gives; nothing is printed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from identify.catalogue.catalogue import CATALOGUE
from identify.design.assessment import Assessment, assess
from identify.design.detection_limits import Limit, detection_limits
from identify.design.next_presses import Proposal
from identify.effects.base import Effect
from identify.fit.files import read_fit
from identify.fit.joint_fit import fit_jointly
from identify.fit.result import Estimate
from identify.fit.result import FitResult as FitRecord
from identify.fit.search import FitIteration
from identify.map.gaussian_map import GaussianMap
from identify.residual import comparison as residual
from identify.select.forward_selection import Explanation as Selection
from identify.select.step import Step
from models.catalogue import Catalogue
from models.errors import InputError
from models.scan_file import read_scan
from palpmap.experiment import Experiment
from palpmap.result.records import ExplainRecord
from palpmap.run_folder import RunFolder
from palpmap.study.open_study import Problem, catalogue_with, own_effects, pose
from palpmap.study.study import Noise, load_study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from identify.select.outlying_presses import WithoutSuspects
    from models.press_program import PressProgram
    from palpmap.result.finding import Finding

Progress = Callable[[str], None]
"""Called with what is being done, in words."""


def _silent(text: str) -> None:
    pass


def _as_text(*renderables: Any) -> str:
    """Return tables and sentences as plain text, 100 columns wide."""
    from rich.console import Console

    console = Console(file=StringIO(), width=100, highlight=False, color_system=None)
    for renderable in renderables:
        console.print(renderable)
    assert isinstance(console.file, StringIO)
    return console.file.getvalue().rstrip() + "\n"


def _drawn(draw: Callable[..., Any], *given: Any) -> Figure:
    from matplotlib import rc_context

    from palpmap.figures.style import STYLE

    with rc_context(STYLE):
        return draw(*given)


@dataclass(frozen=True, eq=False)
class FitResult:
    """A fitted map, with the effects of the study beside it.

    Attributes
    ----------
    experiment : what was fitted
    record : the fit, row by row (`identify.fit.result.FitResult`); positions in the body's frame
    note : what the reader must know of the body's model, or nothing
    """

    experiment: Experiment
    record: FitRecord = field(repr=False)
    note: str = ""

    @property
    def map(self) -> GaussianMap:
        """The map of Young's modulus."""
        return self.record.map

    @property
    def parameters(self) -> Mapping[str, Estimate]:
        """Value, standard deviation, 95 % interval and unit of each parameter, by name."""
        return self.record.parameters

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (k, k) of the free parameters, in their units."""
        return self.record.covariance

    @property
    def residual_m(self) -> np.ndarray:
        """Measured less modelled displacement of each used row, (m,) m."""
        return self.record.residual_m

    @property
    def success(self) -> bool:
        """Whether the fit converged."""
        return self.record.success

    @property
    def message(self) -> str:
        """How the fit ended, in words."""
        return self.record.message

    @cached_property
    def finding(self) -> Finding:
        """The fit with its comparison, as figures and report show it."""
        from palpmap.commands.write_fit_run import finding_of

        made = finding_of(self.record, self.experiment.study, self.experiment.scan)
        return replace(made, limits=(*made.limits, self.note)) if self.note else made

    def summary(self) -> str:
        """Return found map, residual and statement as text."""
        from palpmap.report.fit_console import summary

        return _as_text(*summary(self.finding))

    def plot_map(self) -> Figure:
        """Draw the map of Young's modulus, from above and from the side."""
        from palpmap.figures.map import draw_map

        return _drawn(draw_map, self.finding)

    def plot_residual(self) -> Figure:
        """Draw the residual over the places of the presses."""
        from palpmap.figures.residual import draw_places

        return _drawn(draw_places, self.finding)

    def to_dict(self) -> dict[str, Any]:
        """Return the fit as plain data, as `palpmap fit --json` prints it."""
        from palpmap.commands.fit import fit_record

        return fit_record(self.finding)

    def write(self, folder: str | Path) -> Path:
        """Leave the run folder of `palpmap fit`: fit, comparison, figures, report, recording."""
        from palpmap.commands.fit import RECORDED_PARTS, finish_fit, record_scan, step_recorder
        from palpmap.recording.recorder import Recording
        from palpmap.study.body_model import build_body_model
        from palpmap.study.kept_inputs import keep_inputs
        from palpmap.study.placement import place_scan

        known = self.experiment
        settings = {"inclusions": known.study.map.inclusions}
        with RunFolder("fit", Path(folder), settings=settings, inputs=known.inputs) as run:
            kept = keep_inputs(known.study, known.scan, run.path)
            used = place_scan(known.scan, kept).scan.used()
            body = build_body_model(kept, used)
            presses = len(known.scan.press_ids)
            with Recording(
                run / "recording.rrd",
                kept.name,
                seed=0,
                planned_presses=presses,
                parts=RECORDED_PARTS,
            ) as recording:
                surface = record_scan(recording, body, used)
                record = step_recorder(recording, body, lambda: None, surface)
                for step in self.record.history:
                    record(step)
                finish_fit(run.path, kept, self.record, body, recording)
            return run.path

    def _repr_html_(self) -> str:
        return _html(self.summary(), self.plot_map())


@dataclass(frozen=True, eq=False)
class Comparison:
    """The residual of a fit: is it noise, and if not, along what does it vary.

    Attributes
    ----------
    fit : what is compared with its scan
    record : tests, presses and statement (`identify.residual.comparison.Comparison`)
    """

    fit: FitResult
    record: residual.Comparison = field(repr=False)

    @property
    def is_noise(self) -> bool:
        """Whether the residual is consistent with noise."""
        return self.record.is_noise

    @property
    def tests(self) -> tuple[residual.ResidualTest, ...]:
        """Tests of the residual along place, force, time and order, with their p-values."""
        return tuple(self.record.tests)

    @property
    def statement(self) -> str:
        """The result in one sentence or two."""
        return self.record.statement

    def summary(self) -> str:
        """Return the tests' result as text."""
        return self.fit.summary()

    def plot(self) -> Figure:
        """Draw the residual along all that was tested."""
        from palpmap.figures.residual import draw_along

        return _drawn(draw_along, self.fit.finding)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data, as comparison.json holds it."""
        return self.record.to_dict()

    def _repr_html_(self) -> str:
        return _html(self.statement, self.plot())


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Every effect scored from the present fit, without refitting.

    Attributes
    ----------
    experiment : what was diagnosed
    step : the model with its residual, its tests and the effects' scores
    problem : models of the body and the measurement model
    """

    experiment: Experiment
    step: Step = field(repr=False)
    problem: Problem = field(repr=False)

    @property
    def is_noise(self) -> bool:
        """Whether the residual is consistent with noise."""
        return self.step.comparison.is_noise

    @property
    def significant(self) -> tuple[str, ...]:
        """Names of the effects with a significant score."""
        return tuple(self.step.diagnosis.significant)

    @property
    def candidates(self) -> list[dict[str, Any]]:
        """Score, p-value, verdict and evidence of each effect, as diagnosis.json holds them."""
        return self.to_dict()["candidates"]

    def to_dict(self) -> dict[str, Any]:
        """Return the diagnosis as plain data, as diagnosis.json holds it."""
        from palpmap.commands.diagnose import diagnosis_record

        return diagnosis_record(self.step, self.problem).to_dict()

    def summary(self) -> str:
        """Return the effects, best first, as text."""
        from palpmap.commands.diagnose import diagnosis_table

        return _as_text(*diagnosis_table(self.to_dict(), self.step))


@dataclass(frozen=True, eq=False)
class Explanation:
    """The effects that a scan lacks, found unattended.

    Attributes
    ----------
    experiment : what was explained
    record : the selection (`identify.select.forward_selection.Explanation`)
    problem : models of the body and the measurement model
    assessment : doubts, detection limits and next presses
    without_suspects : the result without outlying presses, None where there are none
    seed : of the simulated null distributions
    """

    experiment: Experiment
    record: Selection = field(repr=False)
    problem: Problem = field(repr=False)
    assessment: Assessment = field(repr=False)
    without_suspects: WithoutSuspects | None = field(default=None, repr=False)
    seed: int = 0

    @property
    def verdict(self) -> str:
        """`nothing_missing`, `explained`, `ambiguous` or `unexplained`."""
        return self.record.verdict

    @property
    def added(self) -> tuple[str, ...]:
        """Effects that are offered by name."""
        return self.record.added

    @property
    def ambiguous(self) -> tuple[tuple[str, ...], ...]:
        """Groups of effects that explain the scan equally well."""
        return self.record.ambiguous

    @property
    def ladder(self) -> tuple[Step, ...]:
        """The models, from the map alone to the last one."""
        return self.record.ladder

    @cached_property
    def _plain(self) -> dict[str, Any]:
        from palpmap.result.explain_record import explain_record

        found = explain_record(self.record, self.problem, self.assessment, self.without_suspects)
        return found.to_dict()

    @property
    def candidates(self) -> list[dict[str, Any]]:
        """Verdict, score and evidence of each effect, as result.json holds them."""
        return self._plain["candidates"]

    @property
    def limits(self) -> list[dict[str, Any]]:
        """Detection limit of each effect, as result.json holds them."""
        return self._plain["limits"]

    @property
    def next_presses(self) -> tuple[Proposal, ...]:
        """Scans that tell an ambiguous group apart, the most telling one first."""
        return self.assessment.next_presses

    @cached_property
    def fit(self) -> FitResult:
        """The last model: map and effects fitted together."""
        return FitResult(self.experiment, replace(self.record.final.fit, history=()))

    def summary(self) -> str:
        """Return ladder, verdict and parameters as text."""
        from palpmap.report.explain_console import explain_summary

        return _as_text(*explain_summary(self._plain, self.record, self.problem))

    def plot_ladder(self) -> Figure:
        """Draw the error of each model beside the noise."""
        from palpmap.figures.ladder import draw_ladder

        return _drawn(draw_ladder, self.record)

    def to_dict(self) -> dict[str, Any]:
        """Return the explanation as plain data, as result.json holds it."""
        return self._plain

    def write(self, folder: str | Path) -> Path:
        """Leave the run folder of `palpmap explain`: result, next scans, report, recording."""
        from palpmap.commands.explain import write_explanation
        from palpmap.study.kept_inputs import keep_inputs, refuse_own_folder

        known = self.experiment
        if known.source is not None:
            refuse_own_folder(known.source, Path(folder))
        with RunFolder("explain", Path(folder), seed=self.seed, inputs=known.inputs) as run:
            kept = keep_inputs(known.study, known.scan, run.path)
            write_explanation(
                run.path,
                self.problem,
                self.record,
                self.assessment,
                kept,
                without=self.without_suspects,
            )
            return run.path

    def _repr_html_(self) -> str:
        return _html(self.summary(), self.plot_ladder())


@dataclass(frozen=True, eq=False)
class Run:
    """A run folder, read back.

    Attributes
    ----------
    folder : where it lies
    experiment : its study and its scan
    fit : the fitted map, of an explanation the last model's
    result : what result.json holds, None of a run without an explanation
    """

    folder: Path
    experiment: Experiment
    fit: FitResult
    result: ExplainRecord | None = field(default=None, repr=False)

    @property
    def verdict(self) -> str | None:
        """The explanation's verdict, None of a run without one."""
        return None if self.result is None else self.result.verdict


def fit(
    experiment: Experiment,
    inclusions: int | Literal["auto"] | None = None,
    *,
    progress: Progress = _silent,
    on_iteration: Callable[[FitIteration], None] | None = None,
) -> FitResult:
    """Find the map that explains a scan, with the effects that the study names.

    Parameters
    ----------
    experiment : scan, body, tip and noise
    inclusions : number of hard or soft inclusions; None takes the study's
    progress : called with what is being done, in words
    on_iteration : called with each accepted step

    Raises
    ------
    InputError
        Scan and study do not fit together: what, where, and what to do.

    Examples
    --------
    >>> import palpmap as pm
    >>> found = pm.fit(pm.read_study("tests/data/lab/case_a/study.toml"))
    >>> found.success, found.parameters["background_pa"].unit
    (True, 'Pa')
    """
    from identify.fit.start_map import fit_map
    from identify.select.start_fit import with_effects
    from palpmap.study.open_study import open_study

    experiment = experiment.with_inclusions(inclusions)
    study = experiment.study
    catalogue = catalogue_with(own_effects(study, ()))
    opened = open_study(study, experiment.scan, catalogue, thin=False, say=progress)
    progress("fitting the map")
    found = fit_map(opened, callback=on_iteration)
    if study.effects:
        progress("fitting the effects")
        found = with_effects(opened, found)
    return FitResult(experiment, found, opened.body.note)


def compare(fit: FitResult) -> Comparison:
    """Test the residual of a fit: is it noise, and if not, along what does it vary."""
    return Comparison(fit, fit.finding.comparison)


def _posed(experiment: Experiment, effects: Sequence[Effect], progress: Progress) -> Problem:
    study = experiment.study
    given = [effect for effect in effects if effect not in CATALOGUE]
    own = (*own_effects(study, ()), *given)
    problem = pose(study, own, progress, measured=experiment.scan)
    wanted = {effect.name for effect in (*effects, *own)}
    wanted |= {entry.name for entry in study.effects}
    return replace(problem, catalogue=Catalogue(e for e in problem.catalogue if e.name in wanted))


def diagnose(
    experiment: Experiment,
    effects: Sequence[Effect] = CATALOGUE,
    *,
    seed: int = 0,
    progress: Progress = _silent,
) -> Diagnosis:
    """Score every effect that the model may lack, without refitting.

    Parameters
    ----------
    effects : candidates; `(*CATALOGUE, MyEffect())` adds one of your own
    seed : of the simulated null distributions
    progress : called with what is being done, in words
    """
    from palpmap.commands.diagnose import judged

    problem = _posed(experiment, effects, progress)
    return Diagnosis(experiment, judged(problem, seed, progress), problem)


def explain(
    experiment: Experiment,
    effects: Sequence[Effect] = CATALOGUE,
    *,
    seed: int = 0,
    progress: Progress = _silent,
    on_step: Callable[[Step], None] | None = None,
) -> Explanation:
    """Find the effects that a scan lacks: score, refit, add, until the residual is noise.

    Parameters
    ----------
    effects : candidates; `(*CATALOGUE, MyEffect())` adds one of your own
    seed : of the simulated null distributions
    progress : called with what is being done, in words
    on_step : called with each new model
    """
    from identify.select import outlying_presses

    problem = _posed(experiment, effects, progress)
    explained, without = outlying_presses.explain(problem, seed, on_step)
    left = outlying_presses.suspects_left(explained, without)
    assessment = assess(explained, problem.catalogue, left, progress)
    return Explanation(experiment, explained, problem, assessment, without, seed)


def limits(
    experiment: Experiment,
    effects: Sequence[Effect] = CATALOGUE,
    *,
    progress: Progress = _silent,
) -> tuple[Limit, ...]:
    """Return the smallest size at which this scan shows each effect, and what it looks like."""
    problem = _posed(experiment, effects, progress)
    found = fit_jointly(problem.model, problem.start)
    progress("computing detection limits")
    return tuple(detection_limits(found, problem.catalogue))


def scan(
    experiment: Experiment | None = None,
    program: PressProgram | str | Path | None = None,
    *,
    force_n: float | None = None,
    presses_per_side: int | None = None,
    plant: Sequence[tuple[str, float]] = (),
    seed: int = 0,
    out: str | Path | None = None,
) -> Experiment:
    """Press on the virtual body with the simulated arm.

    Parameters
    ----------
    experiment : gives the block; None is the built-in phantom
    program : presses in the order in which they are made, or a file of them; None is a grid
    force_n : peak force of the grid's presses
    presses_per_side : of the grid
    plant : names of effects that the scan hides, with their sizes
    seed : of all random numbers
    out : run folder that keeps recording and truth; None keeps the scan alone

    Returns
    -------
    Experiment
        The scan, with the study that goes with it.
    """
    from models.press_program import PressProgram, write_program
    from palpmap.commands.scan import run_scan_command
    from palpmap.console import Output
    from palpmap.study.study import write_study

    with TemporaryDirectory() as spare:
        folder = Path(out) if out is not None else Path(spare) / "scan"
        study = None
        if experiment is not None:
            study = Path(spare) / "study.toml"
            write_study(experiment.study, study)
        if isinstance(program, PressProgram):
            write_program(program, Path(spare) / "program.csv")
            program = Path(spare) / "program.csv"
        run_scan_command(
            study=study,
            force=force_n,
            paper_force=False,
            presses_per_side=presses_per_side,
            out=folder,
            seed=seed,
            output=Output(quiet=True),
            program=None if program is None else Path(program),
            plant=plant,
        )
        made = load_study(folder / "study.toml")
        scanned = read_scan(made.scan, made.study.units_checked)
    return Experiment.of(scanned, made, None if out is None else folder / "study.toml")


def read_run(folder: str | Path) -> Run:
    """Read a run folder that `fit`, `explain` or a `write()` left.

    Raises
    ------
    InputError
        The folder has no fit, or a file in it is broken.
    """
    folder = Path(folder)
    for name in ("fit.json", "study.toml"):
        if not (folder / name).is_file():
            raise InputError(
                f"{folder}: found no {name}, expected a run folder with a fit; make one with "
                "`palpmap fit STUDY --out RUN`"
            )
    study = load_study(folder / "study.toml")
    measured = read_scan(study.scan, study.study.units_checked)
    experiment = Experiment.of(measured, study, folder / "study.toml")
    result = folder / "result.json"
    found = ExplainRecord.read(result) if result.is_file() else None
    return Run(folder, experiment, FitResult(experiment, read_fit(folder / "fit.json")), found)


def _html(text: str, figure: Figure) -> str:
    """Return text above a picture, for a notebook."""
    from base64 import b64encode
    from html import escape

    from palpmap.figures.style import png

    picture = b64encode(png(figure)).decode()
    return f'<pre>{escape(text)}</pre><img src="data:image/png;base64,{picture}">'


__all__ = [
    "Comparison",
    "Diagnosis",
    "Explanation",
    "FitResult",
    "Noise",
    "Run",
    "compare",
    "diagnose",
    "explain",
    "fit",
    "limits",
    "read_run",
    "scan",
]
