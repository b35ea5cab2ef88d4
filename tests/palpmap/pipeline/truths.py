"""How near a found map must come to the true one."""

import json
from pathlib import Path

# Largest deviation from the truth: relative for moduli and radius, in m for the centre.
TOLERANCES = {
    "background_pa": 0.02,
    "inclusion_1.weight_pa": 0.15,
    "inclusion_1.x_m": 0.0005,
    "inclusion_1.y_m": 0.0005,
    "inclusion_1.z_m": 0.003,
    "inclusion_1.radius_m": 0.05,
}


def true_values(folder: Path) -> dict[str, float]:
    """Return the values of the map in a folder's truth.json by parameter."""
    body = json.loads((folder / "truth.json").read_text())["body"]
    (inclusion,) = body["inclusions"]
    named = {f"inclusion_1.{name}": value for name, value in inclusion.items()}
    return {"background_pa": body["background_pa"], **named}


def deviation(name: str, found: float, true: float) -> float:
    """Deviation of a parameter, in the unit of its tolerance."""
    return (found - true) / (true if name.endswith(("_pa", "radius_m")) else 1.0)
