"""Maps of other forms beside an unexplained scan: a cube, physics outside the catalogue, roughness.

The truth has a finer mesh of its own and a map that no inclusion is like.
"""

from dataclasses import replace
from functools import cache
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fem import Contacts, PalpationModel, block_mesh
from identify.body.compliance import compliance
from identify.design import other_map
from identify.map import GaussianMap
from identify.measurement.experiment import BodyModel, FieldGuess, MapGuess, PlacedExperiment
from identify.measurement.noise import Noise
from identify.optimize.result import InadmissibleError
from identify.select import StartFit, start_fit
from identify.select.explanation import Explanation
from identify.select.forward_selection import forward_selection
from identify.select.settings import SELECTION
from models import Catalogue, Scan

SIZE_M, NU, NOISE = (0.06, 0.06, 0.03), 0.45, Noise(1e-5, 2e-3)
PER_SIDE, FORCES_N = 6, np.linspace(0.05, 0.3, 5)


class Cubes(GaussianMap):
    """A hard cube and a soft edge: no sum of one Gaussian and a background."""

    def modulus(self, points, shape=None):
        x, y, z = points.T
        hard = (np.abs(x - 0.022) < 0.01) & (np.abs(y - 0.03) < 0.018) & (z > 0.014)
        return 8e3 * np.where(hard, 3.0, np.where(x > 0.045, 0.5, 1.0))


def contacts() -> Contacts:
    """Two presses at each place, closer together than a map can tell."""
    along = np.linspace(0.009, 0.051, PER_SIDE)
    across = (along[::2, None] + [0.0, 5e-4]).ravel()
    x, y = (a.ravel() for a in np.meshgrid(along, across))
    points = np.column_stack([x, y, np.full(x.size, SIZE_M[2])])
    return Contacts(points, np.tile([0, 0, -1.0], (x.size, 1)), np.full(x.size, 0.003))


def experiment(scan: Scan, guess: MapGuess, cells: tuple[int, int, int]) -> PlacedExperiment:
    model = PalpationModel(block_mesh(SIZE_M, cells), NU, contacts())
    return PlacedExperiment(scan, BodyModel(model, model, model, ""), NOISE, guess)


@cache
def begun(rough: float, wave_m: float, inclusions: int) -> tuple[Scan, StartFit, Explanation]:
    """Scan a body of `Cubes`, fit Gaussians."""
    at, rng = contacts(), np.random.default_rng(5)
    found = compliance(PalpationModel(block_mesh(SIZE_M, (9, 9, 5)), NU, at), Cubes(8e3))
    found = found * np.exp(rough * rng.standard_normal(len(found)))
    n = len(FORCES_N)
    press, force = np.repeat(np.arange(len(at)), n), np.tile(FORCES_N, len(at))
    travel = found[press] * force + wave_m * np.sin(2 * np.pi * force / 0.11)
    scan = Scan(
        press=press, time_s=np.full(len(press), np.nan), phase=np.full(len(press), "load"),
        force_n=force + rng.normal(0, NOISE.force_n, len(press)),
        displacement_m=travel + rng.normal(0, NOISE.displacement_m, len(press)),
        point_m=at.points_m[press], direction=at.directions[press],
        probe_radius_m=at.radius_m[press],
    )  # fmt: skip
    start = start_fit(experiment(scan, MapGuess(inclusions), (5, 5, 3)), Catalogue(()))
    alone = replace(SELECTION, most_effects=0)  # no courses of unknown causes either
    explained = forward_selection(start.model, start.start, start.scan, [], settings=alone)
    return scan, start, replace(explained, verdict="unexplained")


def asked(rough: float = 0.0, wave_m: float = 0.0, inclusions: int = 1, found_none=False):
    """Ask for other maps beside the Gaussians."""
    scan, start, explained = begun(rough, wave_m, inclusions)

    def free() -> PlacedExperiment:
        if found_none:
            raise InadmissibleError("no positive energy")
        return experiment(scan, MapGuess(field=FieldGuess()), (6, 6, 3))

    return other_map(explained, start, free)


@pytest.mark.slow
def test_a_body_of_another_form_is_told():
    found = asked()
    assert found is not None
    assert found.answer == "another_map"
    assert found.more_evidence is not None
    assert found.more_evidence > 10


@pytest.mark.slow
def test_presses_that_differ_by_themselves_are_no_smooth_map():
    found = asked(rough=0.08)
    assert found is not None
    assert found.answer == "rough_map"
    assert 0.03 < found.map_error < 0.15


@pytest.mark.slow
def test_a_search_without_end_leaves_the_question_open():
    found = asked(found_none=True)
    assert found is not None
    assert found.answer == "undecided"
    assert found.chi2_per_dof < 1.2  # the presses alone: they exclude no map


@pytest.mark.slow
def test_no_map_bends_a_curve():
    found = asked(wave_m=4e-4, inclusions=0)
    assert found is not None
    assert found.answer == "no_map"
    assert found.left > 0.5


@pytest.mark.parametrize("verdict", ["explained", "nothing_missing", "ambiguous"])
def test_the_question_arises_beside_an_open_verdict_only(verdict):
    class Answered:
        class final:
            fit = None

    Answered.fitted_verdict = verdict
    assert other_map(Answered, None, None) is None


def test_the_evidence_of_both_maps_counts_presses_alike(monkeypatch):
    """Weights of the presses alone raise a free map's evidence beside a plain criterion."""
    question: Any = import_module("identify.design.other_map")  # the folder has its function's name
    felt, asked = np.ones(3), []
    monkeypatch.setattr(question, "compare", lambda *_: SimpleNamespace(is_noise=True))
    monkeypatch.setattr(
        question, "parametric_evidence", lambda *given: asked.append(given) or -80.0
    )
    free: Any = SimpleNamespace(
        field=SimpleNamespace(hyper=SimpleNamespace(error=0.0), log_evidence=-78.0), chi2=1.0,
        dof=1, chi2_per_dof=1.0, effect_names=(),
        model=SimpleNamespace(map_uncertainty=SimpleNamespace(felt=felt)),
    )  # fmt: skip
    solution = SimpleNamespace(model="model", at=SimpleNamespace(body="body"), u="u")
    last: Any = SimpleNamespace(solution=solution, bic=200.0)
    found = question._answer(free, last, SimpleNamespace(scan=None), 1.0, False, SELECTION)
    assert asked == [("model", "body", "u", felt)]
    assert (found.answer, found.more_evidence) == ("either", 2.0)
    monkeypatch.setattr(question, "compare", lambda *_: SimpleNamespace(is_noise=False))
    for bent, answer in ((False, "no_map"), (True, "undecided")):
        found = question._answer(free, last, SimpleNamespace(scan=None), 1.0, bent, SELECTION)
        assert found.answer == answer
