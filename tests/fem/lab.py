"""Bodies of an independent laboratory with their exact compliances."""

import csv
import json

import numpy as np

from tests.paths import LAB


def lab(case: str) -> tuple[dict, np.ndarray, np.ndarray]:
    """The body, the 81 contact points and their exact compliances."""
    truth = json.loads((LAB / case / "truth.json").read_text())
    with open(LAB / case / "scan.csv", newline="") as file:
        places = {int(r["press"]): [float(r[c]) for c in ("x_m", "y_m", "z_m")]
                  for r in csv.DictReader(file)}  # fmt: skip
    points = np.array([places[j] for j in range(len(places))])
    return truth["body"], points, np.array(truth["compliance_m_per_n"])


def modulus_of(body: dict, points: np.ndarray) -> np.ndarray:
    """Modulus of a body at points (n, 3), Pa."""
    field = np.full(len(points), float(body["background_pa"]))
    for i in body["inclusions"]:
        away = points - [i["x_m"], i["y_m"], i["z_m"]]
        field += i["weight_pa"] * np.exp(-(away**2).sum(axis=1) / (2 * i["radius_m"] ** 2))
    return field
