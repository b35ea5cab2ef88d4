"""The true map of a virtual scan: its scale, its record in truth.json, its values by name."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from identify.map import GaussianMap
from palpmap.result.truth import FILE, TruthRecord
from palpmap.study.truth_file import Truth
from palpmap.study.virtual_lab import truth_of

if TYPE_CHECKING:
    from sim.body import HiddenBody, TruthMap


def true_parameters(truth: "TruthMap") -> dict[str, float]:
    """Return the true map's values by parameter name."""
    record = truth.record()
    values = {"background_pa": record["background_pa"]}
    for number, inclusion in enumerate(record["inclusions"], start=1):
        values |= {f"inclusion_{number}.{name}": value for name, value in inclusion.items()}
    return values


def write_truth(run: Path, body: "HiddenBody", effects: Sequence[Mapping[str, object]]) -> None:
    """Write truth.json: the body with what is hidden in it, and what is hidden."""
    beyond = {"gradient": body.gradient, "poisson_ratio": body.poisson_ratio} if effects else {}
    said = TruthRecord.model_validate(
        {"body": body.truth.record() | beyond, "effects": effects or None}
    )
    said.write(run / FILE)


def truth_of_scan(record: TruthRecord) -> Truth:
    """Return the body of an earlier scan, with the effects that were hidden in it."""
    from sim.scan import Earlier

    effects = [effect.model_dump() for effect in record.effects or ()]
    own = len(record.body.inclusions) - sum(e["name"] == "extra_inclusion" for e in effects)
    found = GaussianMap(record.body.background_pa, record.body.inclusions[:own])
    return Truth(truth_of(found), earlier=Earlier(effects) if effects else None)
