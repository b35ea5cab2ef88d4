"""All that figures and report show of one run: fit, scan, comparison, truth, body, its making."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from identify.body import ChangedMap
from identify.catalogue import CATALOGUE
from identify.fit import Estimate, FitResult
from identify.map import GaussianMap
from identify.residual import Comparison, changed_map
from identify.select import Step
from models import Scan
from palpmap.result.caveats import limits_of, starts_beyond
from palpmap.result.outline import Outline, study_outline
from palpmap.result.records import ParameterRecord
from palpmap.result.truth import FILE as TRUTH
from palpmap.result.truth import matched, read_truth
from palpmap.run_folder import how_made
from palpmap.study.cell_size import probed_part
from palpmap.study.frame import frame_shift_m, in_scan_frame
from palpmap.study.open_study import Problem
from palpmap.study.study import Study
from palpmap.units import plain_name

_BALL = (
    "The tip is a ball. Its contact grows with the force, at the rate that the finite elements say "
    "for the contact of half of the press's depth; the body stays linear."
)


@dataclass(frozen=True)
class Finding:
    """One fitted scan with its comparison; positions are in the body's frame.

    Attributes
    ----------
    name : str
        Name of the study.
    fit, scan, comparison :
        `scan` holds the readings that the fit used.
    outline : Outline
        The body.
    truth : GaussianMap or None
        The true map, of a virtual laboratory only.
    origin_m : (3,)
        Added to a position it gives the scan's own frame.
    stage_s : mapping
        Seconds that each stage took.
    how : mapping
        How the run was made: text by heading.
    limits : tuple of str
        Assumptions and limits in sentences.
    probed_m : (2, 3) or None
        Part of the body that the presses may show; None where that is all of it.
    """

    name: str
    fit: FitResult
    scan: Scan
    comparison: Comparison
    outline: Outline
    truth: GaussianMap | None = None
    origin_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    stage_s: Mapping[str, float] = field(default_factory=dict)
    how: Mapping[str, str] = field(default_factory=dict)
    limits: tuple[str, ...] = ()
    probed_m: np.ndarray | None = None

    @classmethod
    def of(
        cls,
        study: Study,
        fit: FitResult,
        scan: Scan,
        origin_m: np.ndarray,
        comparison: Comparison,
        note: str = "",
    ) -> "Finding":
        """Return the finding of a fit to a placed scan, without truth and making.

        Parameters
        ----------
        note : assumption of the body's model, or nothing
        """
        outline, used = study_outline(study), scan.used()
        height_m = float(outline.upper_m[2] - outline.lower_m[2])
        limits = limits_of(fit, study, used.displacement_m, height_m)
        if fit.solution is not None:
            limits += tuple(starts_beyond(fit.model.effects, study, origin_m))
        probed = probed_part(study.body, scan.contact_points, scan.contact_radii)
        if probed is not None and study.body.shape == "from-contacts":
            probed = probed + outline.lower_m  # from the frame of the bent block
        return cls(
            name=study.name,
            fit=fit,
            scan=used,
            comparison=comparison,
            outline=outline,
            origin_m=origin_m,
            limits=(*limits, note) if note else limits,
            probed_m=probed,
        )

    @cached_property
    def parameters(self) -> Mapping[str, ParameterRecord]:
        """Parameters of the fit, positions in the scan's frame."""
        return parameter_records(self.fit.parameters, self.origin_m, self.fit.at_bound)

    @cached_property
    def doubtful(self) -> tuple[str, ...]:
        """Names of the inclusions that may not be there: their weight may be zero."""
        return tuple(
            name.removesuffix(".weight_pa")
            for name, p in self.parameters.items()
            if name.endswith(".weight_pa") and p.lower95 <= 0 <= p.upper95
        )

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons to distrust the map even where the residual is noise, in sentences."""
        absent = self.doubtful
        kept = len(self.fit.map.inclusions) - len(absent) if absent else 0
        uncertain = (
            f"{plain_name(name).capitalize()} may not be there: its weight may be zero, and its "
            f"place and radius mean something only if it is. Set inclusions = {kept} under [map], "
            "or scan closer."
            for name in absent
        )
        held = (
            f"Not found: {plain_name(name)} stands at the bound of the search."
            for name in self.fit.at_bound
            if name.partition(".")[0] not in absent
        )
        ended = () if self.fit.success else ("The search did not converge.",)
        return (*held, *uncertain, *ended)

    @cached_property
    def true(self) -> Mapping[str, float]:
        """True values by the names of the fit, positions in the scan's frame; empty if unknown."""
        true = {} if self.truth is None else matched(self.fit.map, self.truth)
        return in_scan_frame(true, self.origin_m)

    @cached_property
    def map(self) -> ChangedMap:
        """The found map with the changes by the fitted effects of the catalogue."""
        box_m = np.array([self.outline.lower_m, self.outline.upper_m])
        return changed_map(self.fit, box_m, CATALOGUE)[0]


def parameter_records(
    estimates: Mapping[str, Estimate], origin_m: np.ndarray, at_bound: Sequence[str] = ()
) -> dict[str, ParameterRecord]:
    """Return estimates with their intervals, positions in the scan's frame.

    Parameters
    ----------
    origin_m : (3,) origin of the body's frame in the scan's frame, m
    at_bound : names of the parameters at a bound
    """
    found = {}
    for name, entry in estimates.items():
        shift = frame_shift_m(name, origin_m)
        found[name] = ParameterRecord(
            value=entry.value + shift,
            std=entry.std if entry.free else 0.0,
            lower95=entry.lower95 + shift,
            upper95=entry.upper95 + shift,
            unit=entry.unit,
            at_bound=name in at_bound,
        )
    return found


def step_finding(
    run: Path, problem: Problem, step: Step, estimates: Mapping[str, Estimate] | None = None
) -> Finding:
    """Return a step of an explanation as a finding; its map is fitted jointly with the effects.

    Parameters
    ----------
    estimates : of the step, with the intervals that the answer states; None for its fit's own
    """
    note = _BALL if problem.body.coarse.contacts.profile == "hertz" else problem.body.note
    # Steps of refits are no convergence of a search
    fit = replace(step.fit, history=(), estimates=estimates)
    origin_m = problem.experiment.origin_m
    found = Finding.of(problem.study, fit, problem.scan, origin_m, step.comparison, note)
    truth = read_truth(problem.study.scan.with_name(TRUTH), foreign=True)
    return replace(found, truth=truth, how=how_made(run))
