"""`palpmap new`: a commented study for a scan, from flags or questions."""

from collections.abc import Callable
from pathlib import Path

from pydantic import ValidationError

from models import InputError
from palpmap.console import Output, to_type
from palpmap.importing.new import FLAGS, missing, new_study
from palpmap.study.study import Noise


def run_new(
    *,
    scan: Path,
    out: Path,
    tip: str | None,
    size_m: tuple[float, ...] | None,
    surface: Path | None,
    thickness_m: float | None = None,
    thickness_assumed: bool = False,
    poisson_ratio: float | None,
    origin_m: tuple[float, ...] | None,
    noise: tuple[float | None, float | None],
    inclusions: int | str | None,
    name: str | None,
    ask: Callable[[str], str] | None,
    three: Callable[[str], tuple[float, ...] | None],
    output: Output,
) -> None:
    """Write the study.

    Parameters
    ----------
    ask : puts a question to the user; None where there is no terminal
    three : reads x,y,z

    Raises
    ------
    InputError
        Something that the scan cannot tell is not given: its flag.
    """
    from rich.markup import escape

    body_known = (size_m, surface, thickness_m) != (None, None, None)
    asked = missing(tip=tip, body_known=body_known, poisson_ratio=poisson_ratio)
    if asked and ask is None:
        lacking = "; ".join(f"{flag}: {question}" for flag, question in map(FLAGS.get, asked))  # pyright: ignore[reportGeneralTypeIssues]
        raise InputError(f"the scan does not tell everything; give {lacking}")
    for key in asked:
        assert ask is not None
        answer = ask(FLAGS[key][1].capitalize())
        if key == "tip":
            tip = answer
        elif key == "poisson_ratio":
            poisson_ratio = _number(answer, "--poisson")
        elif Path(answer).suffix.lower() in (".stl", ".obj", ".ply"):
            surface = Path(answer)
        elif "," in answer or "x" in answer:
            size_m = three(answer)
        else:
            thickness_m = _number(answer, "--thickness")
    assert tip is not None
    assert poisson_ratio is not None
    try:
        known = Noise(displacement_m=noise[0], force_n=noise[1])
    except ValidationError as error:
        raise InputError(
            f"--displacement-noise or --force-noise: found {noise[0]} and {noise[1]}, expected "
            "positive numbers in m and N"
        ) from error
    study, said = new_study(
        scan, out, tip=tip, poisson_ratio=poisson_ratio, size_m=size_m, surface=surface,
        thickness_m=thickness_m, thickness_assumed=thickness_assumed,
        origin_m=origin_m, noise=known, inclusions=inclusions, name=name,
    )  # fmt: skip
    output.result(
        {"schema": 1, "study": str(study), "said": said},
        *(f"- {escape(sentence)}" for sentence in said),
        f"Study: {escape(str(study))}",
        f"Next: {escape(to_type('check', study))}",
    )


def _number(text: str, flag: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"{flag}: found '{text}', expected a number") from error
