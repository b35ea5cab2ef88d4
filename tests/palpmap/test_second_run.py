"""A second run into a folder: nothing of the first is taken for its own."""

import pytest

import palpmap as pm
from palpmap.result.records import PlannedScanRecord
from palpmap.run_files import fit_run
from palpmap.run_folder import RunsRecord
from tests.paths import ROOT

TWELVE = ROOT / "tests" / "data" / "twelve_presses" / "study.toml"


def test_a_fit_beside_the_study_of_a_later_run_that_did_not_end_is_refused(tmp_path, monkeypatch):
    fitted = pm.fit(pm.read_study(TWELVE))
    folder = fitted.write(tmp_path / "run")
    study = tmp_path / "study.toml"
    study.write_text(TWELVE.read_text().replace("poisson_ratio = 0.45", "poisson_ratio = 0.3"))
    (tmp_path / "scan.csv").write_bytes(TWELVE.with_name("scan.csv").read_bytes())
    interrupt(fitted, folder, monkeypatch)
    assert pm.read_run(folder).fit.success  # of the same study
    other = pm.fit(pm.read_study(study))
    with pytest.raises(pm.InputError, match="expected a new or empty one"):
        other.write(folder)
    runs = RunsRecord.read(folder / "run.json").runs
    files = dict.fromkeys(map(str, other.experiment.inputs), "0")  # as if edited in place
    changed = tuple(run.changed(inputs=files) for run in runs)
    RunsRecord(runs=changed).write(folder / "run.json")
    interrupt(other, folder, monkeypatch)
    said = r"study\.toml is of the `palpmap fit` that began at .* and did not end, its fit\.json of"
    with pytest.raises(pm.InputError, match=said):
        pm.read_run(folder)
    other.write(folder)
    assert pm.read_run(folder).experiment.study.body.poisson_ratio == 0.3


def interrupt(fit: pm.FitResult, folder, monkeypatch) -> None:
    """Write a fit into a folder, with Ctrl-C once study and scan are there."""

    def stop(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(fit_run.FitRun, "finish", stop)
        with pytest.raises(KeyboardInterrupt):
            fit.write(folder)


def test_a_second_run_of_limits_leaves_no_planned_scan_of_the_first(tmp_path):
    found = pm.limits(pm.read_study(TWELVE), [pm.CATALOGUE["contact_offset"]])
    folder = found.write(tmp_path / "run")
    planned = PlannedScanRecord(change="with twice the force", program="scan_mixed.csv")
    found.record.changed(mixed_scan=planned).write(folder / "limits.json")
    for name in ("scan_mixed.csv", "scan_of_mine.csv"):
        (folder / name).touch()
    found.write(folder)
    assert [path.name for path in folder.glob("scan_*.csv")] == ["scan_of_mine.csv"]


def test_a_second_fit_leaves_no_samples_and_no_volume_of_the_first(tmp_path):
    fitted = pm.fit(pm.read_study(TWELVE))
    folder = fitted.write(tmp_path / "run")
    stale = [folder / name for name in ("map.vti", "posterior.nc", "figures/posterior.png")]
    for path in stale:
        path.touch()
    fitted.write(folder)
    assert not any(path.exists() for path in stale)
