"""The true map of a virtual scan: its scale, its record in truth.json, its values by name."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from identify.map import GaussianMap
from models import InputError
from palpmap.result.truth import FILE, TruthRecord
from palpmap.study.truth_file import Truth, kind_of_law, law_of
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


def write_truth(
    run: Path,
    body: "HiddenBody",
    effects: Sequence[Mapping[str, object]],
    truth: Truth | None = None,
) -> None:
    """Write truth.json: the body with what is hidden in it, and what is hidden.

    Parameters
    ----------
    truth : with the law and the creep of the body; None is linear and elastic
    """
    said: dict[str, object] = dict(body.truth.record())
    if effects:
        said |= {"gradient": body.gradient, "poisson_ratio": body.poisson_ratio}
    if truth is not None and truth.law is not None:
        law = {"kind": kind_of_law(truth.law), "coefficient": truth.law.coefficient}
        said["law"] = law | {"friction": truth.sticking}
    if truth is not None and truth.creep is not None:
        said["creep"] = vars(truth.creep)
    TruthRecord.model_validate({"body": said, "effects": effects or None}).write(run / FILE)


def truth_of_scan(path: Path) -> Truth:
    """Return the body of an earlier scan, of its truth.json, with the effects hidden in it.

    Raises
    ------
    InputError
        The file is no such record, or of a body of regions, whose places are in another file.
    """
    from sim.body import Creep
    from sim.scan import Earlier

    record = TruthRecord.read(path)
    body = record.body
    if body.regions_pa:
        raise InputError(
            f"{path}, key body.regions_pa: found the moduli of labelled regions, whose places are "
            "not in this file; give the TOML file that the scan was made of (in its run.json)"
        )
    effects = [effect.model_dump() for effect in record.effects or ()]
    own = len(body.inclusions) - sum(e["name"] == "extra_inclusion" for e in effects)
    return Truth(
        truth_of(GaussianMap(body.background_pa, body.inclusions[:own])),
        law=body.law and law_of(body.law.kind, body.law.coefficient),
        creep=body.creep and Creep(body.creep.shares, body.creep.times_s),
        earlier=Earlier(effects) if effects else None,
        sticking=body.law is None or body.law.friction,
    )
