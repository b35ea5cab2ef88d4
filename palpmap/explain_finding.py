"""The last rung of an explanation as the finding that `fit` and `compare` show."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from identify.explain import Explanation, Rung
from identify.fit_record import Estimate, Fit
from identify.gaussian_map import GaussianMap, Inclusion
from identify.joint_fit import JointFit
from palpmap.finding import Finding, study_outline
from palpmap.finding_files import how_made
from palpmap.limits import limits_of
from palpmap.problem import Problem
from palpmap.run_folder import read_record

TRUTH = "truth.json"
_NORMAL95 = 1.96


def final_finding(run: Path, problem: Problem, explained: Explanation) -> Finding:
    """Return the last rung as a finding; its map is the one fitted jointly with the effects."""
    return rung_finding(run, problem, explained.final)


def rung_finding(run: Path, problem: Problem, rung: Rung) -> Finding:
    """Return one rung as a finding."""
    runs = read_record(run / "run.json")["runs"] if (run / "run.json").is_file() else []
    outline, used = study_outline(problem.study), problem.scan.used()
    fit = fit_of(problem.fit, rung.fit)
    height_m = float(outline.upper_m[2] - outline.lower_m[2])
    limits = limits_of(fit, problem.study, used.displacement_m, height_m)
    note = problem.body.note
    return Finding(
        name=problem.study.name,
        fit=fit,
        scan=used,
        comparison=rung.comparison,
        outline=outline,
        truth=truth_beside(problem),
        origin_m=problem.placement.origin_m,
        how=how_made(runs),
        limits=(*limits, note) if note else limits,
    )


def truth_beside(problem: Problem) -> GaussianMap | None:
    """Return the true map of a virtual laboratory, if its file lies beside the scan.

    The file may be another laboratory's own: what cannot be read as a map is no truth, and no
    reason to lose a run at its end.
    """
    path = problem.study.scan.with_name(TRUTH)
    try:
        body = json.loads(path.read_text(encoding="utf-8"))["body"]
        inclusions = tuple(Inclusion(**i) for i in body["inclusions"])
        return GaussianMap(float(body["background_pa"]), inclusions)
    except (OSError, KeyError, TypeError, ValueError):
        return None


def fit_of(start: Fit, fit: JointFit) -> Fit:
    """Return a joint fit as the record of a fit: its map, its residuals, its compliances.

    Parameters
    ----------
    start : fit of the map alone, of which noise, readings and mesh errors are kept
    """
    k = len(fit.model.space.free)
    scale = np.abs(fit.model.slope(fit.u)[:k])
    names = fit.model.names[:k]
    covariance = fit.covariance[:k, :k] * np.outer(scale, scale)
    body = fit.at.body
    return replace(
        start,
        map=fit.map,
        parameters=estimates(fit),
        covariance_names=names,
        covariance=covariance,
        latent_force_n=fit.at.latent_force_n,
        predicted_m=fit.at.predicted_m,
        sigma_m=fit.at.sigma_m,
        residual_m=fit.residual_m,
        compliance_m_per_n=body.compliance,
        compliance_jacobian=body.by_map[:, list(fit.model.space.free)],
        history=(),
        chi2=fit.chi2,
        chi2_per_dof=fit.chi2_per_dof,
        rms_m=fit.rms_m,
        success=fit.success,
        nfev=fit.nfev,
    )


def estimates(fit: JointFit) -> dict[str, Estimate]:
    """Return the map's parameters with 95 % intervals, symmetric in their own scale."""
    model, found = fit.model, {}
    deviation = np.sqrt(np.diag(fit.covariance))
    for index, (name, value) in enumerate(zip(fit.map.names, fit.map.values.tolist(), strict=True)):
        unit = "Pa" if name.endswith("_pa") else "m"
        if name not in model.names:
            found[name] = Estimate(value, 0.0, unit, value, value, False)
            continue
        at = model.names.index(name)
        ends = []
        for side in (-1, 1):
            u = fit.u.copy()
            u[at] += side * _NORMAL95 * deviation[at]
            ends.append(float(model.map(u).values[index]))
        found[name] = Estimate(value, fit.std[name], unit, min(ends), max(ends), True)
    return found
