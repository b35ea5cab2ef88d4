"""Results of the search for missing effects: diagnosis, explanation, detection limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pydantic import JsonValue

from identify.design import Assessment, BetterScans, Limit, Proposal
from identify.fit import FitResult as FitRecord
from identify.fit import fit_jointly
from identify.select import Explanation as Selection
from identify.select import Step, WithoutSuspects, fit_with, step_of
from models import InputError, kinds_checked
from palpmap.experiment import Experiment
from palpmap.results import FitResult, Shown, drawn, values_of
from palpmap.run_folder import RunFolder
from palpmap.study.kept_inputs import keep_inputs, refuse_own_folder
from palpmap.study.open_study import Problem
from palpmap.study.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import RenderableType

    from palpmap.result.records import (
        CandidateRecord,
        DiagnosisRecord,
        ExplainRecord,
        LimitRecord,
        LimitsRecord,
    )


@dataclass(frozen=True, eq=False)
class Diagnosis(Shown):
    """Scores of all effects from the present fit, without refitting.

    Attributes
    ----------
    experiment : scan and study
    step : the model with its residual, its tests and the effects' scores
    problem : models of the body and the measurement model
    seed : of the simulated null distributions

    Examples
    --------
    >>> import palpmap as pm
    >>> study = pm.read_study("tests/data/twelve_presses/study.toml")
    >>> (offset,) = pm.diagnose(study, [pm.CATALOGUE["contact_offset"]]).candidates
    >>> offset.name, offset.verdict
    ('contact_offset', 'supported')
    """

    experiment: Experiment
    step: Step = field(repr=False)
    problem: Problem = field(repr=False)
    seed: int = 0

    @property
    def is_noise(self) -> bool:
        """True where the residual is consistent with noise."""
        return self.step.comparison.is_noise

    @property
    def significant(self) -> tuple[str, ...]:
        """Names of the effects with a significant score."""
        return tuple(self.step.diagnosis.significant)

    @cached_property
    def record(self) -> DiagnosisRecord:
        """The content of diagnosis.json."""
        from palpmap.result.explain_record import diagnosis_record

        return diagnosis_record(self.step, self.problem)

    @property
    def candidates(self) -> tuple[CandidateRecord, ...]:
        """Score, p-value, verdict and evidence of each effect, best first."""
        return self.record.candidates

    def to_dict(self) -> dict[str, JsonValue]:
        """Return the diagnosis as plain data, as diagnosis.json holds it."""
        return self.record.to_dict()

    @kinds_checked
    def write(self, folder: str | Path) -> Path:
        """Write the run folder of `palpmap diagnose`: diagnosis.json."""
        inputs = self.experiment.inputs
        with RunFolder("diagnose", Path(folder), seed=self.seed, inputs=inputs) as run:
            self.record.write(run / "diagnosis.json")
            return run.path

    def _renderables(self) -> Sequence[RenderableType]:
        from palpmap.report.diagnose_console import diagnosis_screen

        return diagnosis_screen(self.record, self.step)

    def with_effect(self, name: str) -> Diagnosis:
        """Return the diagnosis of the model with one more effect, all fitted anew.

        Raises
        ------
        InputError
            No such effect, or the scan cannot show it.
        """
        if not isinstance(name, str):
            raise InputError(f"found {name!r}, expected an effect's name, as 'force_drift'")
        effect, score, say = self.problem.catalogue[name], self.step.diagnosis[name], self._say
        if score.untestable is not None:
            raise InputError(f"the effect '{name}' cannot be added: {score.untestable}")
        say(f"fitting map and {name}")
        trial = fit_with(self.step.fit, effect, score)
        if trial is None:
            raise InputError(f"the effect '{name}' leads to an impossible body with this scan")
        fit = fit_jointly(trial.model, trial.map)
        step = step_of(fit, self.problem.scan, self.problem.catalogue, self.seed, say)
        return replace(self, step=step)

    @property
    def _say(self):
        return self.problem.experiment.say


@dataclass(frozen=True, eq=False, repr=False)
class Explanation(Shown, Selection):
    """Missing effects of a scan, found unattended.

    Of the selection it has `verdict` (`nothing_missing`, `explained`, `ambiguous` or
    `unexplained`), `added` (effects offered by name), `ambiguous` (groups of effects that explain
    the scan equally well) and `ladder` (models, from the map alone to the last one).

    Attributes
    ----------
    experiment : scan and study
    problem : models of the body and the measurement model
    assessment : doubts, detection limits and next presses
    seed : of the simulated null distributions

    Examples
    --------
    >>> import palpmap as pm
    >>> study = pm.read_study("tests/data/twelve_presses/study.toml")
    >>> why = pm.explain(study, [pm.CATALOGUE["contact_offset"]])
    >>> [step.fit.effect_names for step in why.ladder]
    [(), ('contact_offset',)]
    """

    experiment: Experiment = field(kw_only=True)
    problem: Problem = field(kw_only=True)
    assessment: Assessment = field(kw_only=True)
    seed: int = field(kw_only=True)

    @classmethod
    def of(cls, found: Selection, *given: Any) -> Self:
        """Return a record of `identify` with experiment, problem, and its consequences."""
        names = ("experiment", "problem", "assessment", "seed")
        return cls(**values_of(found), **dict(zip(names, given, strict=True)))

    def __repr__(self) -> str:
        return f"Explanation({self.experiment.study.name!r}, {self.verdict!r}, added={self.added})"

    @cached_property
    def record(self) -> ExplainRecord:
        """The content of result.json."""
        from palpmap.result.explain_record import explain_record

        return explain_record(self, self.problem, self.assessment)

    @property
    def candidates(self) -> tuple[CandidateRecord, ...]:
        """Verdict, score and evidence of each effect."""
        return self.record.candidates

    @property
    def limits(self) -> tuple[LimitRecord, ...]:
        """Detection limit of each effect.

        Empty for an unexplained scan whose residual is more than twice the noise, by which a limit
        is told.
        """
        return self.record.limits

    @property
    def without_suspects(self) -> WithoutSuspects | None:
        """Result without the outlying presses, None where there are none."""
        return self.assessment.without

    @property
    def next_presses(self) -> tuple[Proposal, ...]:
        """Scans that tell an ambiguous group apart, the most telling one first."""
        return self.assessment.next_presses

    @cached_property
    def fit(self) -> FitResult:
        """The last model: map and effects fitted together."""
        return FitResult.of(replace(self.final.fit, history=()), self.experiment)

    def _renderables(self) -> Sequence[RenderableType]:
        from palpmap.report.explain_console import explain_summary

        return explain_summary(self.record, self, self.problem)

    def _picture(self) -> Figure:
        return self.plot_ladder()

    def plot_ladder(self) -> Figure:
        """Draw the error of each model beside the noise."""
        from palpmap.figures.ladder import draw_ladder

        return drawn(draw_ladder, self)

    def to_dict(self) -> dict[str, JsonValue]:
        """Return the explanation as plain data, as result.json holds it."""
        return self.record.to_dict()

    @kinds_checked
    def write(self, folder: str | Path) -> Path:
        """Write the run folder of `palpmap explain`: result, next scans, report, recording."""
        known = self.experiment
        if known.source is not None:
            refuse_own_folder(known.source, Path(folder))
        with RunFolder("explain", Path(folder), seed=self.seed, inputs=known.inputs) as run:
            self.leave(run.path, keep_inputs(known.study, known.scan, run.path))
            return run.path

    def leave(self, run: Path, kept: Study, files: Mapping[str, Path] | None = None) -> None:
        """Write all files of the explanation into an open run folder.

        Parameters
        ----------
        kept : study that names the folder's own copies of its inputs
        files : of the user's own effects, by name
        """
        from palpmap.result.next_scan import Sites, write_programs
        from palpmap.run_files.explain_run import write_explanation

        write_programs(self.assessment, Sites.of(self.experiment.scan, self.experiment.study), run)
        write_explanation(
            run, self.problem, self, self.assessment, self.record, kept, files,
            self.experiment.source,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Limits(Shown):
    """Detection limits of the effects, in the order of the catalogue; iterates over them.

    Attributes
    ----------
    experiment : scan and study
    problem : models of the body and the measurement model
    fit : model at which they hold
    limits : smallest share of the signal at which each effect is seen, and its likenesses
    better : planned scans that would show smaller effects

    Examples
    --------
    >>> import palpmap as pm
    >>> study = pm.read_study("tests/data/twelve_presses/study.toml")
    >>> [limit.name for limit in pm.limits(study, [pm.CATALOGUE["force_bias"]])]
    ['force_bias']
    """

    experiment: Experiment
    problem: Problem = field(repr=False)
    fit: FitRecord = field(repr=False)
    limits: tuple[Limit, ...]
    better: BetterScans = field(repr=False)

    def __iter__(self) -> Iterator[Limit]:
        return iter(self.limits)

    def __len__(self) -> int:
        return len(self.limits)

    @cached_property
    def record(self) -> LimitsRecord:
        """The content of limits.json."""
        from palpmap.result.explain_record import limits_record

        return limits_record(self.limits, self.better, self.problem, self.fit.field)

    def to_dict(self) -> dict[str, JsonValue]:
        """Return the limits as plain data, as limits.json holds them."""
        return self.record.to_dict()

    @kinds_checked
    def write(self, folder: str | Path) -> Path:
        """Write the run folder of `palpmap limits`: limits.json, and planned scans as programs."""
        with RunFolder("limits", Path(folder), inputs=self.experiment.inputs) as run:
            self.leave(run.path)
            return run.path

    def leave(self, run: Path) -> None:
        """Write all files of the limits into an open run folder."""
        from palpmap.result.next_scan import Sites, write_planned

        write_planned(self.better, Sites.of(self.experiment.scan, self.experiment.study), run)
        self.record.write(run / "limits.json")

    def _renderables(self) -> Sequence[RenderableType]:
        from palpmap.report.limits_console import limits_screen

        return limits_screen(self.record, self.fit)
