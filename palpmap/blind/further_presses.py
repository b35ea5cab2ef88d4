"""`palpmap press`: further presses on the body of a blind trial, the answer still sealed."""

from pathlib import Path

from models import PressProgram, read_program, read_scan, stack_scans, write_scan
from palpmap.blind.records import TrialTruthRecord
from palpmap.blind.robot_trial import further_robot_scan
from palpmap.blind.seal import seal, unseal
from palpmap.console import Output, to_type
from palpmap.study.study import load_study, write_study


def run_press(*, trial: Path, program: Path, output: Output) -> bool:
    """Make a program's presses on a trial's body and write scan and study of all presses so far.

    Parameters
    ----------
    trial : folder of `palpmap blind`
    program : presses as `palpmap explain` proposes them
    """
    unseal(trial)  # says so before anything else where this is no trial
    presses = read_program(program)
    with output.task() as task:
        task.say("pressing")
        study = press_further(trial, presses)
    output.result(
        {"schema": 1, "study": str(study), "presses": len(presses)},
        f"{len(presses)} further presses; {study.name} has them and all that were made before.",
        f"Next: {to_type('explain', study, '--out', trial / f'explained_{number_of(study)}')}",
        f"Then: {to_type('reveal', trial)}",
    )
    return True


def press_further(trial: Path, program: PressProgram) -> Path:
    """Make further presses on a trial's body; return the path of the study with all of them."""
    from sim.bench import further_scan

    before = newest_study(trial)
    study = load_study(before)
    sealed = unseal(trial)
    if sealed.robot:
        further, answer = further_robot_scan(study, sealed, program)
    else:
        further, said = further_scan(sealed.to_dict(), program)
        answer = TrialTruthRecord.model_validate(said)
    number = number_of(before) + 1
    scan = trial / f"scan_{number}.csv"
    write_scan(stack_scans([read_scan(study.scan), further]), scan)
    about = study.study.model_copy(update={"scan": scan.resolve()})
    path = trial / f"study_{number}.toml"
    # Before the study: killed in between, these presses are made but lost
    seal(trial, answer)
    write_study(study.model_copy(update={"study": about}), path)
    return path


def newest_study(trial: Path) -> Path:
    """Return a trial's study with most presses: study.toml, study_2.toml, ..."""
    path, number = trial / "study.toml", 2
    while (later := trial / f"study_{number}.toml").is_file():
        path, number = later, number + 1
    return path


def number_of(study: Path) -> int:
    """Return the number of a trial's study: 1 for study.toml.

    >>> number_of(Path("trial/study.toml")), number_of(Path("trial/study_3.toml"))
    (1, 3)
    """
    _, _, number = study.stem.partition("_")
    return int(number or 1)
