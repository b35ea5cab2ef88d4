"""result.json, diagnosis.json and limits.json: verdicts, steps, candidates, parameters, limits.

Lengths are in m, forces in N, moduli in Pa. Positions are in the scan's frame, as in the study
file. A parameter's name is `background_pa`, `inclusion_1.weight_pa`, `viscoelasticity.g`, ...
"""

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from identify.design import GeometryConfounder, UndetectedBias
from identify.select import CandidateVerdict, Verdict
from palpmap.record import FileRecord, Record


class ValueRecord(Record):
    """A parameter's estimate."""

    value: float = Field(description="estimate, in the parameter's unit")
    std: float = Field(description="one standard error, in the parameter's unit; 0 of a fixed one")


class ParameterRecord(ValueRecord):
    """A parameter's estimate with its 95 % interval."""

    lower95: float = Field(description="lower end of the 95 % interval, in `unit`")
    upper95: float = Field(description="upper end of the 95 % interval, in `unit`")
    unit: str = Field(description="SI unit; 1 of a number without one")
    at_bound: bool = Field(description="estimate on the bound of what is allowed, so not found")


class StepRecord(Record):
    """A model of the selection path, fitted: its errors and its residual."""

    effects: tuple[str, ...] = Field(description="names of the model's effects beside the map")
    rms_m: float = Field(description="residual, root mean square, m")
    held_out_rms_m: float = Field(description="error of the cross-validation by presses, rms, m")
    held_out_high_rms_m: float | None = Field(
        description="error at the largest forces, left out of the fit, rms, m; null if not tested"
    )
    noise_rms_m: float = Field(description="residual expected of the noise alone, rms, m")
    chi2_per_dof: float = Field(description="chi-square per degree of freedom")
    is_noise: bool = Field(description="residual consistent with noise")
    statement: str = Field(description="the residual in one sentence")
    parameters: Mapping[str, ValueRecord] = Field(description="estimates by parameter")


class CandidateRecord(Record):
    """An effect of the catalogue, with the numbers of the step that decided on it."""

    name: str
    rms_m: float = Field(description="the effect's part of the readings, estimated, rms, m")
    visible: float = Field(description="share of its pattern that the fitted parameters leave")
    values: Mapping[str, float] = Field(description="first estimate of its parameters, SI units")
    untestable: str | None = Field(description="why the scan cannot show it, else null")
    verdict: CandidateVerdict
    score: float = Field(description="decrease of chi-square")
    p_value: float = Field(description="probability of such a decrease under noise alone")
    explained_fraction: float = Field(description="share of the unexplained chi-square, 0 to 1")
    confused_with: tuple[str, ...] = Field(description="effects with the same pattern here")
    evidence: str = Field(description="what its values mean, in one sentence")
    family: str = Field(default="", description="simplest effect of the same cause; forms share it")


class CountRecord(Record):
    """How many presses of a scan were used."""

    presses_used: int = Field(default=0, description="presses in the fit")
    presses_left_out: int = Field(
        default=0, description="presses left out, evenly spread, as too many"
    )


class DiagnosisRecord(CountRecord, StepRecord, FileRecord):
    """diagnosis.json: the present model, and every effect scored from it without refitting."""

    parameters: Mapping[str, ParameterRecord] = Field(description="estimates by parameter")
    candidates: tuple[CandidateRecord, ...] = Field(description="effects, best score first")


class NextPressesRecord(Record):
    """A scan that would tell the effects of an ambiguous group apart."""

    change: str = Field(description="what to do, a sentence without its full stop")
    why: str = Field(description="what it brings, a clause")
    discrimination: float | None = Field(description="expected difference in chi-square")
    presses: int = Field(description="number of presses")
    duration_s: float = Field(description="duration of the scan, s")
    program: str = Field(description="file of the press program in the run folder")
    separates: bool = Field(
        default=True, description="at least two effects of the group, beyond doubt"
    )


class PlannedScanRecord(Record):
    """A changed scan that would show more."""

    change: str = Field(description="difference from the scan that was made")
    program: str = Field(description="file of the press program in the run folder")


class BetterScanRecord(PlannedScanRecord):
    """A changed scan that shows an effect from a smaller size on."""

    smallest_share: float = Field(description="smallest size seen, of the signal")
    confused_with: tuple[str, ...] = Field(description="effects with the same pattern there")


class LimitRecord(Record):
    """Smallest visible effect of this scan, and the map's bias where it is ignored."""

    name: str
    smallest_share: float | None = Field(description="size at 5 standard errors, of the signal")
    largest_share: float | None = Field(
        description="largest possible size, of the signal, where even that is not seen"
    )
    shape: Mapping[str, float] = Field(description="its other parameters, for which this holds")
    sizes: Mapping[str, float] = Field(description="amplitudes at that size, SI units")
    visible: float = Field(description="share of its pattern that the map leaves")
    confused_with: tuple[str, ...] = Field(description="effects with the same pattern here")
    map_bias: Mapping[str, float] = Field(
        description="shift of each parameter, in its unit, by an ignored effect of `bias_at_share`"
    )
    bias_at_share: float = Field(description="size for which `map_bias` holds, of the signal")
    untestable: str | None = Field(description="why the scan cannot show it, else null")
    better_scan: BetterScanRecord | None = Field(description="cheapest scan that shows more")
    in_mixed_scan: float | None = Field(description="smallest size seen in the mixed scan")


class LimitsRecord(CountRecord, FileRecord):
    """limits.json: detection limits, and scans that would show more."""

    limits: tuple[LimitRecord, ...]
    mixed_scan: PlannedScanRecord | None = Field(description="scan with all changes at once")
    sight_m: float | None = Field(
        default=None, description="depth of sight of a free map at the middle press, m, or null"
    )
    labelled: bool = Field(False, description="it is that of changes within labelled regions")


class PressesFitRecord(Record):
    """Error of the presses fitted one by one, each with a compliance of its own and no map."""

    rms_n: float = Field(description="error, root mean square, N")
    typical_n: float = Field(description="error of the middle press, N")
    share_of_largest_force: float = Field(description="rms over the largest force")
    chi2_per_dof: float = Field(description="chi-square per degree of freedom")
    noise_share: float = Field(description="share of the presses with residuals of pure noise")


class PressesAloneRecord(Record):
    """Findings of the presses without a map."""

    effects: tuple[str, ...] = Field(description="effects that they call for")
    values: Mapping[str, Mapping[str, float]] = Field(description="estimates by effect, SI units")
    as_good: Mapping[str, tuple[str, ...]] = Field(description="equal alternatives by effect")
    largest_force_n: float = Field(description="largest force of the scan, N")
    before: PressesFitRecord = Field(description="without these effects")
    after: PressesFitRecord = Field(description="with them")
    share_taken: float = Field(description="share of the excess misfit that they take")
    map_error: float = Field(description="relative error of the map's compliances, 0 if noise")
    again: int = Field(default=0, description="presses of places that were pressed before")
    refuted: tuple[tuple[str, ...], ...] = Field(
        default=(), description="effects that do as well, but for presses of one place"
    )


class FormRecord(Record):
    """A model as good as the last one, with a candidate in place of an accepted effect."""

    in_place_of: str = Field(description="the accepted effect; empty for the last model itself")
    effect: str = Field(description="the candidate; empty for the last model itself")
    weight: float = Field(
        description="share among all these models, by evidence; alike for equal laws of contact"
    )


class FormCurveRecord(Record):
    """What an effect of the last model adds, along its argument, with its 95 % band."""

    effect: str
    along: str = Field(description="the argument in words")
    at_unit: str = Field(description="its unit")
    of: str = Field(description="the quantity in words")
    unit: str = Field(description="its unit; 1 of a share")
    at: tuple[float, ...] = Field(description="places along the argument")
    value: tuple[float, ...] = Field(description="added there")
    lower95: tuple[float, ...] = Field(description="lower end of the band")
    upper95: tuple[float, ...] = Field(description="upper end of the band")
    places_m: tuple[tuple[float, ...], ...] = Field(
        default=(),
        description="contact points of what goes with the place, in the body's frame; else empty",
    )


class WithoutSuspectsRecord(Record):
    """The result without the outlying presses."""

    verdict: Verdict
    added: tuple[str, ...] = Field(description="effects offered by name")
    ambiguous: tuple[tuple[str, ...], ...] = Field(description="groups of equal explanations")
    chi2_per_dof: float = Field(description="chi-square per degree of freedom")
    parameters: Mapping[str, float] = Field(description="estimates in the body's frame, SI units")
    residual: str = Field(description="the residual in one sentence")


class OtherMapRecord(Record):
    """Residual of an unexplained scan beside maps of any form."""

    answer: Literal["another_map", "either", "rough_map", "no_map", "undecided"] = Field(
        description="a map of another form leaves noise, with more evidence or with less; only one "
        "with an error of its own in each press does; none does; or none was found"
    )
    chi2_per_dof: float = Field(description="chi-square per degree of freedom with such a map")
    left: float = Field(description="share of the unexplained chi-square that remains")
    map_error: float = Field(description="relative error of the free map in each press, or 0")
    more_evidence: float | None = Field(
        description="log evidence of the free map less that of inclusions, null if not fitted"
    )
    effects: tuple[str, ...] = Field(description="effects beside it")


class ExplainRecord(CountRecord, FileRecord):
    """result.json of `palpmap explain`."""

    verdict: Verdict
    added: tuple[str, ...] = Field(description="effects offered by name")
    ambiguous: tuple[tuple[str, ...], ...] = Field(description="groups of equal explanations")
    unknown: tuple[str, ...] = Field(
        default=(),
        description="courses of the model that stand in for causes outside the catalogue",
    )
    reliable: bool = Field(
        default=True,
        description="values and intervals count all that is seen; false where structure remains, "
        "whose cause moves them by an unknown amount",
    )
    few_presses: tuple[int, ...] = Field(
        default=(),
        description="presses that alone hold the structure that remains, ids; empty if more do",
    )
    traces: tuple[str, ...] = Field(
        default=(), description="significant effects too small to be added"
    )
    helpers: tuple[str, ...] = Field(
        default=(), description="effects of the model, not offered by name"
    )
    ladder: tuple[StepRecord, ...] = Field(
        default=(), description="from the map alone to the last model"
    )
    candidates: tuple[CandidateRecord, ...] = Field(
        default=(), description="effects of the catalogue"
    )
    parameters: Mapping[str, ParameterRecord] = Field(
        default={},
        description="of the last model; intervals are averaged over the forms",
    )
    forms: tuple[FormRecord, ...] = Field(
        default=(), description="models that the scan does not separate, the last one first"
    )
    form_curves: tuple[FormCurveRecord, ...] = Field(
        default=(), description="effects of the last model that can be drawn"
    )
    residual: str = Field(default="", description="the last model's residual in one sentence")
    suspect_presses: tuple[int, ...] = Field(
        default=(), description="outliers for the map alone, ids"
    )
    presses_apart: Mapping[int, float] = Field(
        default={},
        description="share by which presses that stand apart travel further at the same force than "
        "a model that meets all others, by id: left out of all else",
    )
    suspects_left: tuple[int, ...] = Field(
        default=(), description="outliers for the last model too, ids"
    )
    without_suspects: WithoutSuspectsRecord | None = Field(
        default=None, description="result without the outlying presses, null if there are none"
    )
    explained_share: float = Field(
        default=0.0, description="share of the excess chi-square that the effects take"
    )
    presses_alone: PressesAloneRecord | None = Field(
        default=None, description="what the presses show without a map, null if not asked"
    )
    unseen_inclusions: tuple[int, ...] = Field(
        default=(), description="numbers of the inclusions that can be left out together"
    )
    stated_lengths: tuple[GeometryConfounder, ...] = Field(
        default=(), description="lengths of the study whose error would look like an effect"
    )
    finer_cells: str | None = Field(
        default=None, description="what a finer mesh would tell, else null"
    )
    other_map: OtherMapRecord | None = Field(
        default=None, description="what other maps leave of an unexplained scan, null if not asked"
    )
    next_presses: tuple[NextPressesRecord, ...] = Field(
        default=(), description="the best one first"
    )
    limits: tuple[LimitRecord, ...] = Field(
        default=(),
        description="detection limits of the first step; empty where nothing explains a residual "
        "of more than twice the noise",
    )
    detection_limits: Mapping[str, float] = Field(
        default={}, description="smallest share of the signal seen, by effect"
    )
    never_seen: tuple[str, ...] = Field(default=(), description="effects not seen at any size")
    unseen_shifts: Mapping[str, UndetectedBias] = Field(
        default={},
        description="largest shift of each parameter by an effect that the scan does not show",
    )
    not_counted: tuple[str, ...] = Field(
        default=(), description="effects whose shift of the parameters the scan cannot bound"
    )
