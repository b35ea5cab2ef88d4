"""The true map of a virtual scan: its scale, its record in truth.json, its values by name."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from palpmap.result.truth import FILE, TruthRecord

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
