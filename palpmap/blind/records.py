"""The files of blind trials: sealed answers, judged findings, lines and rates of a tournament."""

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from identify.design import UndetectedBias
from identify.select import Verdict
from palpmap.record import FileRecord, Record
from palpmap.result.truth import HiddenEffectRecord, TruthRecord
from palpmap.study.study import Noise

Outcome = Literal["right", "honest", "missed", "wrong"]
Groups = tuple[tuple[str, ...], ...]


class TrialTruthRecord(TruthRecord):
    """Hidden effect of a blind trial, with the data for further presses."""

    effects: tuple[HiddenEffectRecord, ...] = Field(description="what is hidden")
    seed: int | None = Field(default=None, description="of everything in the trial")
    noise: Noise = Field(
        default=Noise(), description="one standard deviation of each reading, m and N"
    )
    radii_m: tuple[float, ...] | None = Field(default=None, description="radii of the tips, m")
    size_m: tuple[float, float, float] | None = Field(
        default=None, description="edges of the block, m; of the paper's if null"
    )
    poisson_ratio: float | None = Field(
        default=None, description="of the block; of the paper's if null"
    )
    divisions: tuple[int, int, int] | None = Field(
        default=None, description="of the truth's finer mesh along x, y and z; the usual if null"
    )
    robot: bool = Field(default=False, description="the virtual robot pressed")
    program: Mapping[str, tuple[float, ...]] | None = Field(
        default=None, description="the presses made, column by column, SI units"
    )
    compliance_m_per_n: tuple[float, ...] | None = Field(
        default=None, description="of every press as it was made, m/N"
    )


class SealRecord(FileRecord):
    """The sealed answer: a truth that is not to be read by accident."""

    note: str = "open with: palpmap reveal"
    answer_base64: str = Field(description="the truth's JSON text, base64")
    sha256: str = Field(description="of that text, hexadecimal")


class FoundRecord(Record):
    """A parameter as an explanation found it; older ones have no interval."""

    value: float
    std: float | None = None
    lower95: float | None = None
    upper95: float | None = None


class ProgramRecord(Record):
    """Presses that an explanation proposes."""

    program: str = Field(description="file of the press program")


class AnswerRecord(FileRecord):
    """What is judged: the part of a result.json, or an answer given by hand."""

    verdict: Verdict
    added: tuple[str, ...] = Field(default=(), description="effects offered by name")
    ambiguous: Groups = Field(default=(), description="groups of equal explanations")
    parameters: Mapping[str, FoundRecord] = {}
    unseen_shifts: Mapping[str, UndetectedBias] = {}
    detection_limits: Mapping[str, float] = Field(
        default={}, description="share of the signal by effect"
    )
    never_seen: tuple[str, ...] = ()
    next_presses: tuple[ProgramRecord, ...] = ()


class ScoreRecord(Record):
    """How good an answer is."""

    category: str = Field(description="none, structured, compliance, pair or outsider")
    outcome: Outcome = Field(
        description="right; honest where it does not know and says so; missed where it sees "
        "nothing; wrong where it is sure of what is not so"
    )
    passed: bool = Field(description="by the table of `palpmap.blind.score`")
    reason: str = Field(description="one sentence")


class MapErrorRecord(Record):
    """A parameter of the map, found and true, in its unit."""

    name: str
    found: float
    std: float | None = Field(default=None, description="one standard error")
    true: float
    inside: bool | None = Field(default=None, description="truth within the 95 % interval")
    unseen_shift: float | None = Field(
        default=None, description="shift allowed for undetected effects"
    )


class RevealRecord(ScoreRecord, FileRecord):
    """Output of `palpmap reveal --json`."""

    hidden: tuple[HiddenEffectRecord, ...]
    verdict: Verdict
    added: tuple[str, ...]
    ambiguous: Groups
    map: tuple[MapErrorRecord, ...]
    result: str | None = Field(description="file that was judged")


class AtFirstRecord(Record):
    """An answer before further presses were made."""

    verdict: Verdict
    added: tuple[str, ...]
    ambiguous: Groups


class TrialLine(Record):
    """A line of trials.jsonl: one trial of a tournament, judged or failed."""

    number: int
    trial: Mapping[str, object] = Field(default={}, description="what was drawn")
    hidden: tuple[str, ...] = Field(description="names of the hidden effects")
    error: str | None = Field(default=None, description="fault of the program that ended the trial")
    at_first: AtFirstRecord | None = None
    further_presses: int | None = Field(default=None, description="number of presses made after it")
    sizes: tuple[float, ...] | None = Field(
        default=None, description="of the signal, by hidden effect"
    )
    verdict: Verdict | None = None
    added: tuple[str, ...] = ()
    ambiguous: Groups = ()
    category: str = ""
    outcome: Outcome | None = None
    passed: bool = False
    reason: str = ""
    map: tuple[MapErrorRecord, ...] = ()
    made_s: float | None = Field(default=None, description="time to make the scan, s")
    explained_s: float | None = Field(default=None, description="time to explain it, s")

    def to_json(self) -> str:
        """Return the line, without its end."""
        return self.model_dump_json(exclude_unset=True, exclude_none=True)


class RatesRecord(Record):
    """Counts of the trials of one kind."""

    trials: int = 0
    passed: int = 0
    right: int = 0
    honest: int = 0
    missed: int = 0
    wrong: int = 0


class CoverageRecord(Record):
    """How often the 95 % intervals of a parameter held the truth."""

    intervals: int
    held: int


class TournamentRecord(FileRecord):
    """tournament.json: rates by category and by hidden effect."""

    trials: int
    failed: int
    errors: tuple[str, ...]
    passed: int
    wrong: int
    categories: Mapping[str, RatesRecord]
    effects: Mapping[str, RatesRecord]
    confusion: Mapping[str, Mapping[str, int]] = Field(
        description="how often an answer was given, by hidden effects"
    )
    coverage: Mapping[str, CoverageRecord] = Field(description="by parameter of the map")
