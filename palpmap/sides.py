"""Sides of a body from contacts that its study does not state: found by evidence."""

from __future__ import annotations

from collections.abc import Iterator

from fem import MeshError
from identify import PlacedExperiment, Progress, silent
from identify.design import likeliest_body
from models import InputError, thinned, touching
from palpmap.experiment import Experiment
from palpmap.study.contact_body import assumed_margin_m
from palpmap.study.open_study import catalogue_with

HALVINGS = 3  # of a margin of 3/4 of the thickness: a tip hangs over nearer sides
PRESSES = 36  # the outermost among them: enough to tell the sides


def with_sides(experiment: Experiment, progress: Progress = silent) -> Experiment:
    """Return the experiment with the margin beyond its contacts that has the most evidence.

    Any other body, and one with a stated margin, stays as it is. The margin of three quarters of
    the thickness is halved as long as the evidence of a free map rises, and the best one taken
    where that is clear: a wider body makes up for a free side by softer places, which bends the
    curves of a ball's presses wrongly.
    """
    body = experiment.study.body
    if body.margin_assumed or (widest_m := assumed_margin_m(body)) is None:
        return experiment
    margins_m = [widest_m / 2**halved for halved in range(HALVINGS + 1)]
    tried: list[Experiment] = []
    some = thinned(touching(experiment.scan), PRESSES)

    def bodies() -> Iterator[PlacedExperiment]:
        for margin_m in margins_m:
            sides = {"margin_m": margin_m, "margin_assumed": True}
            study = experiment.study.model_copy(update={"body": body.model_copy(update=sides)})
            tried.append(Experiment.of(experiment.scan, study, experiment.source))
            progress("fitting a free map, to find the body's sides")
            try:
                opened = Experiment.of(some, study, experiment.source).of_kind("free").opened()
            except (InputError, MeshError):  # a tip hangs over nearer sides
                if margin_m == widest_m:
                    raise
                return
            yield opened

    best, evidence = likeliest_body(bodies(), catalogue_with(experiment.own_effects))
    shown = ", ".join(
        f"{1e3 * margin_m:.3g} mm ({e - evidence[best]:+.1f})"
        for margin_m, e in zip(margins_m, evidence, strict=False)
    )
    progress(f"sides beyond the contacts, by the log evidence: {shown}")
    return tried[best]
