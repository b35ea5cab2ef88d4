"""`palpmap new`: a commented study for a scan, from flags or questions."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from models import InputError
from palpmap.console import Output, plain, to_type
from palpmap.importing.new import FLAGS, Facts, new_study, read_own
from palpmap.result.press_outcomes import FILE as PRESSES
from palpmap.result.press_outcomes import PressesRecord
from palpmap.units import rms


def run_new(
    *,
    scan: Path,
    out: Path,
    facts: Facts,
    ask: Callable[[str], str] | None,
    three: Callable[[str], tuple[float, ...] | None],
    output: Output,
) -> None:
    """Write the study.

    Parameters
    ----------
    facts : given by flags
    ask : puts a question to the user; None where there is no terminal
    three : reads x,y,z

    Raises
    ------
    InputError
        Something that the scan cannot tell is not given: its flag.
    """
    if facts.missing:
        read_own(scan)  # no question before the answer that the file has another form
    if facts.missing and ask is None:
        lacking = "; ".join(": ".join(FLAGS[key]) for key in facts.missing)
        raise InputError(f"the scan does not tell everything; give {lacking}")
    for key in facts.missing:
        assert ask is not None
        what = question = FLAGS[key][1][0].upper() + FLAGS[key][1][1:]
        while True:
            try:
                facts = replace(facts, **_read(key, ask(question), three))
                break
            except InputError as error:
                question = f"{error}. {what}"
    facts, touch = with_stated_touch(facts, scan)
    study, said = new_study(scan, out, facts)
    said += touch
    output.result(
        {"schema": 1, "study": str(study), "said": said},
        *plain([f"- {sentence}" for sentence in said]),
        *plain([f"Study: {study}", f"Next: {to_type('check', study)}"]),
    )


def with_stated_touch(facts: Facts, scan_file: Path) -> tuple[Facts, list[str]]:
    """Return the facts with the error of first touch that a robot states, and say so.

    That error shifts all travel of a press: not counted, it is structure of the residual. The facts
    are as they were where they have it, or without presses.json of the scan's presses beside it.
    """
    stated = scan_file.with_name(PRESSES)
    if facts.touch_noise_m is not None or not stated.is_file():
        return facts, []
    try:
        record = PressesRecord.read(stated)
    except InputError as error:
        return facts, [f"{error}. The study counts no error of first touch."]
    measured = {one.press: one.measured for one in record.presses}
    presses = [measured.get(number) for number in read_own(scan_file).press_ids.tolist()]
    noise = facts.noise.with_touch([one.touch_sd_m for one in presses if one is not None])
    if None in presses or noise.touch_m is None:
        return facts, []
    said = (
        f"{PRESSES} beside the scan states the depth of first touch to {rms(noise.touch_m)}, one "
        "standard deviation; the study counts it as noise.touch_m."
    )
    return replace(facts, touch_noise_m=noise.touch_m), [said]


def _read(key: str, answer: str, three: Callable[[str], tuple[float, ...] | None]) -> dict:
    """Return the fact that an answer states, by its name in `Facts`."""
    if key == "tip":
        if answer not in ("flat", "sphere"):
            raise InputError(f"--tip: found '{answer}', expected flat or sphere")
        return {"tip": answer}
    if key == "poisson_ratio":
        if not 0 <= (ratio := _number(answer, "--poisson")) < 0.5:
            raise InputError(f"--poisson: found {answer}, expected 0 to 0.4999")
        return {"poisson_ratio": ratio}
    if Path(answer).suffix.lower() in (".stl", ".obj", ".ply"):
        return {"surface": Path(answer)}
    if "," in answer or "x" in answer:
        return {"size_m": three(answer)}
    return {"thickness_m": _number(answer, "--thickness")}


def _number(text: str, flag: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"{flag}: found '{text}', expected a number") from error
