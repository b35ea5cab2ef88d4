"""One explanation reads its scan, estimates its noise and meshes its body once."""

import functools
import sys
import tomllib

import numpy as np
import pytest
import tomli_w

import palpmap as pm
import palpmap.api
import palpmap.run_files.explain_run
from fem import block_mesh
from identify.measurement.noise import scan_noise
from models.scan_file import read_scan
from tests.identify.select.loop_problem import scan, timing, true_compliance
from tests.palpmap.report.loop_study import few, put

SLIPPED = (7, 20)
MESHES = 3  # of a block: two that are extrapolated, and a cruder one on which starts are tried


def slipped():
    """Twelve presses, of which two travel further at the same force."""
    press, _, _, force = timing(5)
    factor = np.where(np.isin(press, SLIPPED), 1.3, 1.0)
    return few(scan(factor * true_compliance()[press] * force, force, 5))


@pytest.fixture
def count(monkeypatch):
    """Count the calls of functions wherever they are imported; they still run."""

    def counted(function) -> list:
        calls = []

        @functools.wraps(function)
        def wrapped(*args, **kwargs):
            calls.append(args)
            return function(*args, **kwargs)

        for name, module in list(sys.modules.items()):
            if name.partition(".")[0] in ("palpmap", "identify", "fem", "models", "sim"):
                for attribute, value in list(vars(module).items()):
                    if value is function:
                        monkeypatch.setattr(module, attribute, wrapped)
        return calls

    return counted


@pytest.mark.slow
def test_scan_noise_and_meshes_are_made_once_though_presses_stand_out(tmp_path, count):
    study = put(tmp_path / "study", slipped())
    tables = tomllib.loads(study.read_text())
    del tables["noise"]
    study.write_text(tomli_w.dumps(tables))
    reads, estimates, meshes = count(read_scan), count(scan_noise), count(block_mesh)
    effects = [effect for effect in pm.CATALOGUE if effect.name in ("force_bias", "force_drift")]
    why = pm.explain(pm.read_study(study), effects)
    why.write(tmp_path / "run")
    assert why.record.suspect_presses == SLIPPED
    assert tuple(why.record.presses_apart) == SLIPPED  # fits with and without them were made
    assert why.final.comparison.is_noise
    assert why.record.other_map is None  # it has a mesh of its own
    assert (len(reads), len(estimates), len(meshes)) == (1, 1, MESHES)
