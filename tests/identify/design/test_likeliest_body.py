"""Which of several bodies a scan speaks for."""

from dataclasses import replace

import pytest

import palpmap as pm
from identify.catalogue import CATALOGUE
from identify.design.likeliest_body import _with_law, likeliest_body
from identify.fit import fit_map
from palpmap.experiment import Experiment


def test_bodies_are_compared_beside_the_contact_law_of_the_presses():
    study = pm.read_study("tests/data/twelve_presses/study.toml")
    assert _with_law(study.opened(), CATALOGUE) == ()  # presses that are nearly straight
    scan = study.scan.replace(displacement_m=study.scan.displacement_m + 1e-3)
    experiment = Experiment.of(scan, study.study, study.source)
    opened = experiment.opened()
    ((effect, values),) = _with_law(opened, CATALOGUE)
    assert effect.name == effect.family == "contact_offset"
    assert values["offset_m"] == pytest.approx(1e-3, rel=0.3)
    # One that the study names stays as it is
    stated = ((effect, {"offset_m": values["offset_m"]}),)
    assert _with_law(replace(opened, effects=stated), CATALOGUE) == stated
    # The map's evidence is that beside the law
    free = experiment.of_kind("free").opened()
    found, (evidence,) = likeliest_body([free], CATALOGUE)
    alone = fit_map(free, rough=True).field
    assert alone is not None
    assert found == 0
    assert evidence > alone.log_evidence + 10
