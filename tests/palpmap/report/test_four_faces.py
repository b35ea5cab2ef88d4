"""result.json, terminal, report and recording state the same of one explanation."""

import json
import re
from dataclasses import replace
from io import StringIO

import pytest
from rerun.chunk import RrdReader
from rich.console import Console

from identify.select.verdicts import effect_verdict
from palpmap.recording import entities as parts
from palpmap.recording.explain_text import about_text
from palpmap.report.explain_console import explain_summary
from palpmap.report.explain_report import write_explain_report
from palpmap.result.explain_record import explain_record
from palpmap.result.finding import step_finding
from palpmap.run_files.explain_run import write_explain_files
from palpmap.run_folder import RunFolder
from tests.palpmap.report.page import Page

HEADLINES = {
    "Explained": "explained",
    "No missing effect": "nothing_missing",
    "Ambiguous": "ambiguous",
    "Unexplained": "unexplained",
}
WORDS = {
    "supported": "supported",
    "indistinguishable": "indistinguishable",
    "partial, structure remains": "helps",
    "not seen": "not_seen",
    "cannot be tested": "untestable",
}
UNITS = {"kPa": 1e3, "mm": 1e-3, "µm": 1e-6, "mN": 1e-3}


def number(text):
    """The value in SI units of a quantity as it is shown."""
    value, _, unit = text.partition(" ")
    return float(value) * UNITS.get(unit, 1.0)


def label(name):
    """A parameter as the faces call it: the map's in words, an effect's as it is."""
    if not name.startswith(("background", "inclusion")):
        return name
    return re.sub(r"_(pa|m)$", "", name).replace(".", " ").replace("_", " ")


def in_json(path):
    """What result.json states: verdict, verdict on each effect, parameters, errors by step."""
    record = json.loads(path.read_text(encoding="utf-8"))
    return {
        "verdict": record["verdict"],
        "effects": {c["name"]: c["verdict"] for c in record["candidates"]},
        "parameters": {
            label(name): (p["value"], p["lower95"], p["upper95"]) if p["std"] else (p["value"],)
            for name, p in record["parameters"].items()
        },
        "errors": [
            (s["rms_m"], s["held_out_rms_m"], s["noise_rms_m"], s["chi2_per_dof"])
            for s in record["ladder"]
        ],
    }


def stated(headline, rows):
    """What a face states, from its headline and the cells of its tables."""
    (verdict,) = (v for start, v in HEADLINES.items() if headline.startswith(start))
    found = {"verdict": verdict, "effects": {}, "parameters": {}, "errors": []}
    heading = ""
    for row in rows:
        if row[0] in ("Parameter", "Model", "Effect", "Verdict"):
            heading, head = row[0], row
        elif heading == "Parameter" and re.search(r"held| to ", " ".join(row)):
            at = head.index("After" if "After" in head else "Found")
            ends = re.fullmatch(r"(\S+) to (\S+)( \S+)?", row[at + 1])
            interval = [number(end + (ends[3] or "")) for end in ends.groups()[:2]] if ends else []
            found["parameters"][row[0]] = (number(row[at]), *interval)
        elif heading == "Model" and "µm" in row[1]:
            cells = dict(zip(head, row, strict=True))
            lengths = (cells[name] for name in ("Error (rms)", "Cross-validation", "Noise"))
            found["errors"].append((*map(number, lengths), float(cells["Chi2/dof"])))
        elif heading == "Verdict" and row[0] in WORDS:
            found["effects"] |= dict.fromkeys(row[1].split(", "), WORDS[row[0]])
        elif heading == "Effect" and row[1] in WORDS:
            found["effects"][row[0]] = WORDS[row[1]]
    return found


def in_terminal(explained, record, problem):
    console = Console(width=160, file=StringIO())
    for line in explain_summary(record, explained, problem):
        console.print(line)
    lines = [line.strip() for line in console.file.getvalue().splitlines()]  # type: ignore[attr-defined]
    (headline,) = (line for line in lines if line.startswith(tuple(HEADLINES)))
    rows = [re.split(r"\s{2,}", line) for line in lines]
    return stated(headline, [row for row in rows if len(row) > 1])


def in_report(path):
    page = Page(path.read_text(encoding="utf-8"))
    (headline,) = (h for h in page.headings if h.startswith(tuple(HEADLINES)))
    return stated(headline, page.rows)


def in_recording(text):
    headline = re.search(r"\*\*(.*?)\*\*", text)[1]
    lines = (line.strip("| ") for line in text.splitlines() if line.startswith("|"))
    return stated(headline, [[cell.strip() for cell in line.split("|")] for line in lines])


def about(path):
    """The text of a recording."""
    texts = [
        text
        for chunk in RrdReader(path).stream()
        if chunk.entity_path == f"/{parts.ABOUT}"
        for (text,) in chunk.to_record_batch().column("TextDocument:text").to_pylist()
    ]
    return texts[-1]


def agree(face, wanted):
    """Whether a face states what result.json does, to the digits that it shows."""

    def near(shown, true, **allowed):
        return len(shown) == len(true) and list(shown) == pytest.approx(list(true), **allowed)

    def digits(value, low=0.0, high=0.0):  # half of the last digit that the standard error leaves
        return {"abs": 0.15 * (high - low) / 3.92, "rel": 0.0 if high > low else 1e-3}

    same = [face[key] == wanted[key] for key in ("verdict", "effects")]
    same += [
        face["parameters"].keys() == wanted["parameters"].keys(),
        *(
            near(face["parameters"].get(n, ()), p, **digits(*p))
            for n, p in wanted["parameters"].items()
        ),
        len(face["errors"]) == len(wanted["errors"]),
        *(near(*pair, rel=0.03) for pair in zip(face["errors"], wanted["errors"], strict=False)),
    ]
    return all(same)


@pytest.fixture(scope="module")
def real(explained_case):
    """result.json and the three other faces of a run, as they stand in its folder."""
    case = explained_case
    return in_json(case.folder / "result.json"), {
        "terminal": in_terminal(case.explained, case.record, case.problem),
        "report": in_report(case.folder / "report.html"),
        "recording": in_recording(about(case.folder / "recording.rrd")),
    }


@pytest.mark.parametrize("face", ["terminal", "report", "recording"])
def test_a_face_states_what_result_json_states(real, face):
    wanted, faces = real
    assert wanted["verdict"] == "explained"
    assert len(wanted["effects"]) == 4
    assert len(wanted["parameters"]) == 8
    assert faces[face]["effects"] == wanted["effects"]
    assert agree(faces[face], wanted)


def test_another_verdict_value_or_error_is_no_agreement(real):
    wanted, faces = real
    creep, weight = "viscoelasticity", "inclusion 1 weight"
    value, low, high = wanted["parameters"][weight]
    others = (
        {"verdict": "ambiguous"},
        {"effects": {**wanted["effects"], creep: "helps"}},
        {"parameters": {**wanted["parameters"], weight: (value + 0.1 * (high - low), low, high)}},
        {"parameters": {**wanted["parameters"], weight: (value, low, high + 0.1 * (high - low))}},
        {"errors": wanted["errors"][:1]},
    )
    for face in faces.values():
        assert not any(agree(face, {**wanted, **other}) for other in others)


@pytest.mark.parametrize("verdict", ["ambiguous", "unexplained", "nothing_missing"])
def test_the_faces_agree_on_every_verdict(explained_case, tmp_path, verdict):
    case = explained_case
    accepted = case.explained.accepted
    if verdict == "ambiguous":
        first = accepted[0].candidates[0]
        other = replace(first, name="hysteresis", criterion=first.criterion + 1)
        accepted = (replace(accepted[0], candidates=(first, other)),)
    ladder = case.explained.ladder
    if verdict == "nothing_missing":
        accepted, ladder = (), ladder[1:]
    explained = replace(case.explained, verdict=verdict, accepted=accepted, ladder=ladder)
    catalogue = [e for e in case.problem.catalogue if e.name not in ladder[0].fit.effect_names]
    verdicts = tuple(effect_verdict(effect, explained) for effect in catalogue)
    assessment = replace(case.assessment, verdicts=verdicts)
    record = explain_record(explained, case.problem, assessment)
    record.write(tmp_path / "result.json")
    wanted = in_json(tmp_path / "result.json")
    finding = step_finding(case.folder, case.problem, explained.final)
    report = tmp_path / "report.html"
    write_explain_report(report, finding, explained, record, case.problem, {})
    assert wanted["verdict"] == verdict
    assert agree(in_terminal(explained, record, case.problem), wanted)
    assert agree(in_report(report), wanted)
    assert agree(in_recording(about_text("a scan", explained, record)), wanted)


def test_fit_json_states_the_intervals_of_the_result(explained_case, tmp_path):
    case, name = explained_case, "background_pa"
    own = case.assessment.parameters[name]
    wide = {**case.assessment.parameters, name: replace(own, lower95=0.5 * own.lower95)}
    assessment = replace(case.assessment, parameters=wide)
    record = explain_record(case.explained, case.problem, assessment)
    with RunFolder("explain", tmp_path / "run", seed=0, inputs=[]) as run:
        write_explain_files(run.path, case.problem, case.explained, assessment, record)
    said = json.loads((tmp_path / "run" / "fit.json").read_text())["parameters"][name]
    assert said["lower95"] == record.parameters[name].lower95 == 0.5 * own.lower95


def test_another_form_is_told_from_another_cause():
    from types import SimpleNamespace
    from typing import Any

    from palpmap.report.diagnose_console import _best_evidence

    def candidate(name: str, family: str) -> SimpleNamespace:
        return SimpleNamespace(
            name=name, family=family, evidence="It creeps.",
            confused_with=("power_law_creep", "hysteresis", "breathing"),
        )  # fmt: skip

    record: Any = SimpleNamespace(
        candidates=[
            candidate("viscoelasticity", "viscoelasticity"),
            candidate("power_law_creep", "viscoelasticity"),
            candidate("hysteresis", "hysteresis"),
            candidate("breathing", "breathing"),
        ]
    )
    diagnosis: Any = SimpleNamespace(
        scores=record.candidates, significant={"viscoelasticity", "power_law_creep", "hysteresis"}
    )
    says = _best_evidence(record, diagnosis)
    assert "(hysteresis would look much the same" in says
    assert says.endswith(
        "Its form is open: power_law_creep would be the same cause by another law."
    )
