"""The run folder and the exit codes that go with how a run ended."""

import errno
import json
import subprocess
import sys
import warnings

import pytest
import typer
from filelock import FileLock

from fem.errors import MeshError, SolverError
from models.errors import InputError
from palpmap.console import Output, SentenceWarning, answers
from palpmap.record import SCHEMA, FileRecord
from palpmap.run_folder import RunFolder, RunsRecord, sha256


def exit_code(command) -> int:
    try:
        answers(command)()
    except typer.Exit as end:
        return end.exit_code
    return 0


def runs_of(folder) -> list[dict]:
    return json.loads((folder / "run.json").read_text())["runs"]


def test_a_run_says_how_it_was_made(tmp_path):
    study = tmp_path / "study.toml"
    study.write_bytes(b"palpmap")
    out = tmp_path / "my run"
    with RunFolder("fit", out, seed=7, settings={"inclusions": 2}, inputs=[study]) as run:
        assert runs_of(out)[0]["outcome"] == "running"
        (run / "fit.json").touch()
    (entry,) = runs_of(out)
    assert (entry["command"], entry["seed"], entry["outcome"]) == ("fit", 7, "done")
    assert entry["settings"] == {"inclusions": 2}
    # SHA-256 of the seven letters, from coreutils' sha256sum.
    assert entry["inputs"] == {str(study): SHA_OF_PALPMAP}
    assert entry["versions"]["palpmap"] == "0.2.0"
    assert entry["versions"]["numpy"][0].isdigit()
    assert entry["ended"] >= entry["started"]


def test_a_second_command_adds_to_the_run(tmp_path):
    with RunFolder("scan", tmp_path / "run", seed=1) as run:
        (run / "study.toml").touch()
    for command in ("fit", "fit", "compare"):
        with RunFolder(command, tmp_path / "run", inputs=[tmp_path / "run" / "study.toml"]) as run:
            (run / "report.html").touch()
    runs = runs_of(tmp_path / "run")
    assert [entry["command"] for entry in runs] == ["scan", "fit", "fit", "compare"]


def test_a_run_is_not_mixed_with_another_study_or_report(tmp_path, monkeypatch):
    study, other, folder = tmp_path / "study.toml", tmp_path / "other.toml", tmp_path / "run"
    study.write_text("one")
    other.write_text("another")
    with RunFolder("fit", folder, inputs=[study]) as run:
        (run / "study.toml").touch()
        (run / "report.html").touch()
    for command, inputs in (
        ("fit", [other]),
        ("explain", [study]),
        ("predict", [folder / "study.toml", other]),
        ("explain", [folder / "study.toml"]),
        ("demo", []),
    ):
        with pytest.raises(InputError, match=f"the run folder of `palpmap fit {study}`, expected"):
            RunFolder(command, folder, inputs=inputs)
    monkeypatch.chdir(tmp_path)
    for name in ("study.toml", study):  # written in two ways, and edited
        with RunFolder("fit", folder, inputs=[name]):
            study.write_text("edited")
    assert [entry["command"] for entry in runs_of(folder)] == ["fit", "fit", "fit"]


@pytest.mark.parametrize(
    "fault", [OSError(errno.ENOLCK, "No locks available"), NotImplementedError()]
)
def test_a_file_system_without_locks_is_said_in_one_sentence(tmp_path, monkeypatch, capsys, fault):
    """A fault that this machine's file system has not: the system's lock raises it."""

    def refuses(*_):
        raise fault

    monkeypatch.setattr(FileLock, "_acquire", refuses)

    def command():
        with RunFolder("fit", tmp_path / "run") as run:
            (run / "fit.json").touch()

    with pytest.warns(SentenceWarning, match="knows no locks"):
        command()
    monkeypatch.setattr(warnings, "filters", [])
    assert exit_code(command) == 0
    said = capsys.readouterr().err
    assert said.startswith(f"palpmap: {tmp_path / 'run'}: this file system knows no locks")
    assert said.count("\n") == 1
    assert [entry["outcome"] for entry in runs_of(tmp_path / "run")] == ["done", "done"]


def test_without_out_each_run_gets_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, second = RunFolder("demo"), RunFolder("demo")
    assert first.path != second.path
    assert first.path.parent.name == "runs"
    assert first.path.name.startswith("demo-2")


def test_a_folder_with_other_things_in_it_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(InputError, match="a folder with other things in it"):
        RunFolder("fit", tmp_path)
    with pytest.raises(InputError, match="found a file, expected a folder"):
        RunFolder("fit", tmp_path / "thesis.tex")
    with pytest.raises(InputError, match="the run folder cannot be made"):
        RunFolder("fit", tmp_path / "thesis.tex" / "run")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_two_commands_do_not_write_into_one_folder_at_a_time(tmp_path):
    folder = tmp_path / "run"
    code = (
        "import sys, time; from palpmap.run_folder import RunFolder; run = RunFolder('fit', "
        "sys.argv[1]); print('there', flush=True); time.sleep(600)"
    )
    other = subprocess.Popen([sys.executable, "-c", code, str(folder)], stdout=subprocess.PIPE)
    with other:
        assert other.stdout
        assert other.stdout.readline().strip() == b"there"
        with pytest.raises(InputError, match="another command is writing into this run folder"):
            RunFolder("fit", folder)
        other.kill()
    with RunFolder("fit", folder):  # what was killed holds nothing back
        with pytest.raises(InputError, match="another command"):
            RunFolder("fit", folder)
    assert [path.name for path in folder.iterdir()] == ["run.json"]
    runs = runs_of(folder)
    assert [(entry["command"], entry["outcome"]) for entry in runs] == [
        ("fit", "running"),
        ("fit", "done"),
    ]


def test_ctrl_c_leaves_a_readable_run_folder(tmp_path, capsys):
    def command():
        with RunFolder("scan", tmp_path / "run") as run:
            (run / "scan.csv").write_text("so far")
            raise KeyboardInterrupt

    assert exit_code(command) == 130
    assert f"interrupted, run folder is readable: {tmp_path / 'run'}\n" in capsys.readouterr().err
    (entry,) = runs_of(tmp_path / "run")
    assert entry["outcome"] == "interrupted"
    assert (tmp_path / "run" / "scan.csv").read_text() == "so far"
    assert exit_code(command) == 130
    said = "files that it had not yet replaced are of the run before"
    assert f"{tmp_path / 'run'}; {said}\n" in capsys.readouterr().err


def test_a_failed_run_records_its_error(tmp_path):
    with pytest.raises(InputError), RunFolder("fit", tmp_path / "run"):
        raise InputError("scan.csv: the file is empty")
    (entry,) = runs_of(tmp_path / "run")
    assert entry["outcome"] == "failed: scan.csv: the file is empty"


def raising(error):
    def command():
        raise error

    return command


@pytest.mark.parametrize(
    ("command", "code"),
    [
        (lambda: None, 0),
        (lambda: True, 0),
        (lambda: False, 1),
        (raising(InputError("a sentence")), 2),
        (raising(MeshError("a sentence")), 2),
        (raising(SolverError("a sentence")), 2),
        (raising(KeyboardInterrupt()), 130),
    ],
)
def test_how_a_command_ends_decides_the_exit_code(command, code, capsys):
    assert exit_code(command) == code
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err == {2: "palpmap: a sentence\n", 130: "palpmap: interrupted\n"}.get(code, "")


def test_a_fault_of_the_program_is_not_dressed_up():
    with pytest.raises(ValueError, match="broadcast"):
        answers(raising(ValueError("could not broadcast")))()


class Misfit(FileRecord):
    """A record for these tests alone."""

    rms_m: float
    unit: str = "m"


def test_a_record_is_read_back_with_its_schema(tmp_path):
    Misfit(rms_m=1e-5).write(tmp_path / "fit.json")
    written = json.loads((tmp_path / "fit.json").read_text())
    assert written == {"schema": SCHEMA, "rms_m": 1e-5, "unit": "m"}
    assert Misfit.read(tmp_path / "fit.json") == Misfit(rms_m=1e-5)
    newer = {**written, "schema": SCHEMA + 1}
    (tmp_path / "fit.json").write_text(json.dumps(newer))
    with pytest.raises(InputError, match="key schema: found 2, expected at most 1; update palpmap"):
        Misfit.read(tmp_path / "fit.json")


def test_an_older_record_lacks_what_has_a_default_and_may_hold_more(tmp_path):
    (tmp_path / "fit.json").write_text('{"schema": 1, "rms_m": 1, "of_old": true}')
    assert Misfit.read(tmp_path / "fit.json") == Misfit(rms_m=1)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "cannot be read"),
        ('{"schema": 1, "runs": [', "not JSON"),
        ("[1, 2]", "key schema: found None"),
        ('{"runs": []}', "key schema: found None"),
        ('{"schema": 1, "runs": 3}', "key runs: expected a list"),
        ('{"schema": 1}', "key runs: expected this key; run the command that writes it again"),
    ],
)
def test_a_broken_record_is_refused(text, sentence, tmp_path):
    if text is not None:
        (tmp_path / "run.json").write_text(text)
    with pytest.raises(InputError, match=rf"run.json.*{sentence}"):
        RunsRecord.read(tmp_path / "run.json")


def test_nan_never_gets_into_a_record(tmp_path):
    with pytest.raises(ValueError, match="finite number"):
        Misfit(rms_m=float("nan")).write(tmp_path / "fit.json")
    assert not (tmp_path / "fit.json").exists()


def test_json_and_text_never_mix_on_stdout(capsys):
    output = Output(json=True)
    output.say("for a person")
    output.result({"a": 1}, "a table")
    assert json.loads(capsys.readouterr().out) == {"a": 1}
    Output(quiet=True, json=True).result({"a": 1}, "a table")
    assert json.loads(capsys.readouterr().out) == {"a": 1}
    Output(quiet=True).result({"a": 1}, "a table")
    assert capsys.readouterr().out == ""
    Output().result({"a": 1}, "a table")
    assert capsys.readouterr().out == "a table\n"


def test_progress_goes_to_stderr_and_is_silent_if_quiet(capsys):
    for quiet, said in ((False, True), (True, False)):
        with Output(quiet=quiet).task() as task:
            task.say("presses")
        captured = capsys.readouterr()
        assert captured.out == ""
        assert ("presses" in captured.err) is said


def test_hash_of_a_file(tmp_path):
    (tmp_path / "a").write_bytes(b"palpmap")
    assert sha256(tmp_path / "a") == SHA_OF_PALPMAP


SHA_OF_PALPMAP = "a0ed3939528f94a1ed9852f4efda6f6fc441547124a1f1fc7c0975a036fabcac"
