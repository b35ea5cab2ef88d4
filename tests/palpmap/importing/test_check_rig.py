"""`palpmap check-rig` finds in a raw stream the errors that were put into it."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from palpmap.__main__ import app
from tests.palpmap.importing import raw_streams

SEED = 3
DRIFT_N_PER_S = 2e-3


def check(stream, folder, *words: object, code: int = 0):
    folder.mkdir(exist_ok=True)
    rig = folder / "rig.toml"
    rig.write_text(raw_streams.RIG, encoding="utf-8")
    result = CliRunner().invoke(
        app, ["check-rig", *map(str, stream.write(folder)), "--rig", str(rig), *map(str, words)]
    )
    assert result.exit_code == code, result.output
    return result


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    stream = raw_streams.draw(SEED)
    found = check(stream, tmp_path_factory.mktemp("plain"), "--json")
    return stream, json.loads(found.stdout)


def test_noise_and_lag_are_those_of_the_stream(plain):
    stream, found = plain
    assert found["noise_n"] == pytest.approx(stream.force_noise, rel=0.3)
    assert found["noise_m"] == pytest.approx(stream.pose_noise, rel=0.3)
    assert abs(found["lag_s"] - stream.offset_s) < 3 * found["lag_error_s"]
    assert abs(found["hysteresis_n"]) < 5 * stream.force_noise


def test_a_bias_and_a_drift_are_found(plain, tmp_path):
    _, before = plain
    added = raw_streams.draw(SEED)
    time = added.force_time - added.force_time.mean()
    added.force[:, 0] += 0.3
    added.force[:, 2] -= DRIFT_N_PER_S * time  # pressing is along -z
    found = json.loads(check(added, tmp_path / "a", "--json").stdout)
    bias = np.array(found["bias_n"]) - before["bias_n"]
    np.testing.assert_allclose(bias[:2], [0.3, 0.0], atol=5e-3)
    drift = found["drift_n_per_min"] - before["drift_n_per_min"]
    assert drift == pytest.approx(60 * DRIFT_N_PER_S, rel=0.1)


def test_the_page_holds_the_table_and_a_picture(plain, tmp_path):
    result = check(plain[0], tmp_path / "p", "--out", tmp_path / "rig.html")
    page = (tmp_path / "rig.html").read_text(encoding="utf-8")
    for word in ("Bias", "Drift", "Residue of gravity", "Hysteresis", "Noise of the force", "Lag"):
        assert word in page
        assert word in result.stdout
    assert "data:image/png" in page


def test_readings_are_refused(tmp_path):
    stream = raw_streams.draw(SEED)
    files = stream.write(tmp_path)
    rig = tmp_path / "rig.toml"
    rig.write_text(raw_streams.RIG.replace('"stream"', '"readings"'), encoding="utf-8")
    result = CliRunner().invoke(app, ["check-rig", *map(str, files), "--rig", str(rig)])
    assert result.exit_code == 2
    assert "key kind" in result.stderr
