"""JSON Schemas of palpmap's files: `python -m palpmap.schemas docs/schema` writes them."""

import argparse
import json
from collections.abc import Mapping
from pathlib import Path

from pydantic import Field, JsonValue, TypeAdapter

from identify.fit import (
    Area,
    Estimate,
    FitIteration,
    Hyper,
    RegionEstimate,
    SampledParameter,
    Spot,
)
from identify.map import Grid
from identify.measurement import Noise
from identify.residual import Comparison
from palpmap.blind.records import (
    RevealRecord,
    SealRecord,
    TournamentRecord,
    TrialLine,
    TrialTruthRecord,
)
from palpmap.commands.check import CheckRecord
from palpmap.paper.command import PaperRecord
from palpmap.prediction_results import DifferenceRecord, PredictionRecord
from palpmap.record import FileRecord, Record
from palpmap.result.history import HistoryRecord
from palpmap.result.press_outcomes import PressesRecord
from palpmap.result.records import DiagnosisRecord, ExplainRecord, LimitsRecord
from palpmap.result.scan_record import ScanRecord
from palpmap.result.truth import TruthRecord
from palpmap.run_folder import RunsRecord

Row = tuple[float, ...]
Rows = tuple[Row, ...]


class FreeMapRecord(Record):
    """A free map: the logarithm of Young's modulus on a grid of g points, the last axis fastest."""

    grid: Grid
    log_pa: Row = Field(description="ln of the modulus in Pa, (g,)")
    regions: Mapping[str, JsonValue] | None = Field(
        default=None, description="labelled regions, body frame; see `models.LabelVolume.to_dict`"
    )


class FreeFieldRecord(Record):
    """Prior, precision, sight, spots and areas of a free map."""

    hyper: Hyper
    log_evidence: float = Field(description="of the readings, over that of noise alone")
    effective: float = Field(description="effective number of the map's parameters")
    log_mean: float = Field(description="mean of ln E (E in Pa) over the seen part")
    log_mean_sd: float = Field(description="its standard deviation")
    log_sd: Row = Field(description="standard deviation of ln E, (g,)")
    share: Row = Field(description="share of the prior's variance taken away, (g,)")
    sight_m: float = Field(description="depth of sight of the middle press, m")
    by_press_m: Row = Field(description="travel by ln C of its press, m, (m,)")
    followed: Rows = Field(description="directions of ln C that the map can follow, (j, k)")
    press_error: Row = Field(
        description="what the readings of each press ask its ln C to change by, (j,)"
    )
    left_out: Row = Field(description="the same of presses that the map has not seen, (j,)")
    errs: tuple[bool, ...] = Field(description="presses weighted down, (j,)")
    slips: Row = Field(
        default=(),
        description="probability that a press slipped, and no ball is there, (j,)",
    )
    lengths_m: tuple[float, float] = Field(description="least and largest length tried, m")
    spots: tuple[Spot, ...]
    areas: tuple[Area, ...] = Field(
        default=(), description="whose presses feel a harder or softer body"
    )
    ball_sight_m: float = Field(
        default=0.0,
        description="depth down to which a ball of 10 mm would be seen, m; 0 if at none",
    )
    regions: tuple[RegionEstimate, ...] = Field(default=(), description="of labelled regions")


class PosteriorRecord(Record):
    """Draws from the posterior of map and effects; they stand in posterior.nc."""

    samples: int = Field(description="number of draws")
    chains: int = Field(description="independent chains among them")
    seed: int = Field(description="of the random numbers")
    parameters: Mapping[str, SampledParameter] = Field(
        description="free parameters by name, in their units"
    )


class FitRecord(FileRecord):
    """fit.json: a fit of j presses with m readings, k free parameters of map and effects."""

    map: Mapping[str, float] | FreeMapRecord = Field(
        description="estimated map, body frame, m and Pa: parameters by name, or a free map"
    )
    parameters: Mapping[str, Estimate] = Field(description="of map and effects, by name")
    covariance_names: tuple[str, ...] = Field(description="names of the free parameters, (k,)")
    covariance: Rows = Field(description="of the free parameters, in their units, (k, k)")
    noise: Noise
    press_index: tuple[int, ...] = Field(description="press of each reading, from 0, (m,)")
    force_n: Row = Field(description="measured force, N, (m,)")
    displacement_m: Row = Field(description="measured travel, m, (m,)")
    latent_force_n: Row = Field(description="best estimate of the true force, N, (m,)")
    predicted_m: Row = Field(description="travel of the model, m, (m,)")
    sigma_m: Row = Field(description="standard deviation of the residual, m, (m,)")
    residual_m: Row = Field(description="measured less predicted travel, m, (m,)")
    compliance_m_per_n: Row = Field(description="of the fitted model, m/N, (j,)")
    compliance_jacobian: Rows = Field(
        description="derivative of the compliance by the map's free parameters, (j, k')"
    )
    discretization_error: Row | None = Field(
        description="relative error of the coarse mesh's compliance, (j,); null if not estimated"
    )
    history: tuple[FitIteration, ...] = Field(description="accepted steps of the search")
    chi2: float = Field(description="chi-square of all readings")
    chi2_per_dof: float = Field(description="chi-square per degree of freedom")
    rms_m: float = Field(description="residual, root mean square, m")
    success: bool = Field(description="whether the search converged")
    message: str = Field(description="how the search ended")
    nfev: int = Field(description="evaluations of the finite element model")
    model_error: Row | None = Field(
        default=None, description="relative error of the finer model, (j,); null if not estimated"
    )
    derivative_m: Rows | None = Field(
        default=None, description="derivative of the travel by the free parameters, (m, k)"
    )
    field: FreeFieldRecord | None = Field(default=None, description="of a free map")
    at_bound: tuple[str, ...] = Field(
        default=(), description="parameters on a bound of the search, so not found"
    )
    posterior: PosteriorRecord | None = Field(
        default=None, description="draws from the posterior; null if none were asked for"
    )


RECORDS: Mapping[str, type[FileRecord] | type[TrialLine]] = {
    "check": CheckRecord,
    "diagnosis": DiagnosisRecord,
    "fit": FitRecord,
    "history": HistoryRecord,
    "limits": LimitsRecord,
    "paper": PaperRecord,
    "presses": PressesRecord,
    "result": ExplainRecord,
    "difference": DifferenceRecord,
    "prediction": PredictionRecord,
    "reveal": RevealRecord,
    "run": RunsRecord,
    "scan": ScanRecord,
    "sealed_answer": SealRecord,
    "tournament": TournamentRecord,
    "trial_line": TrialLine,
    "trial_truth": TrialTruthRecord,
    "truth": TruthRecord,
}
"""Records by the name of their schema's file."""


def schemas() -> dict[str, dict[str, JsonValue]]:
    """Return the JSON Schema of every file, by the name of the schema's file."""
    found = {name: kind.model_json_schema() for name, kind in RECORDS.items()}
    comparison = TypeAdapter(Comparison).json_schema()
    version = found["fit"]["properties"]["schema"]
    per_dof = {"type": "number", "description": "chi-square per degree of freedom"}
    comparison["properties"] |= {"schema": version, "chi2_per_dof": per_dof}
    return dict(sorted({**found, "comparison": comparison}.items()))


def write_schemas(folder: Path) -> None:
    """Write each schema into a folder, as NAME.json."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, schema in schemas().items():
        text = json.dumps(schema, indent=1, sort_keys=True)
        (folder / f"{name}.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write the JSON Schemas of all records.")
    parser.add_argument("folder", type=Path, help="such as docs/schema")
    write_schemas(parser.parse_args().folder)
