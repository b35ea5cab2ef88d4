"""Sizes of a study that only make sense in other units than SI."""

from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from models import InputError

if TYPE_CHECKING:
    from palpmap.study.study import Study

LARGEST_BODY_M = 1.0
LARGEST_RADIUS_M = 0.05
LARGEST_NOISE_M = 0.005
SOFTEST_BASE_M_PER_PA = 1e-3  # a body of 50 mm and 1 kPa is 5e-5 m/Pa
SOFTEST_BODY_PA = 50.0
HARDEST_BODY_PA = 1e7  # the rubber of a car's tyre; a scan of a harder body is refused, too
_IN_FILE = "set units_checked = true under [study]"
_IN_PYTHON = "give units_checked=True"


def check_units(path: Path | None, study: "Study") -> None:
    """Refuse sizes that only make sense in millimetres or grams.

    Parameters
    ----------
    path : of the study file; None for one that was made in Python
    """
    where = "" if path is None else f"{path}, key "
    escape = f"if the value is right, {_IN_PYTHON if path is None else _IN_FILE}"
    lengths = [("body.size_m", size, LARGEST_BODY_M) for size in study.body.size_m or ()]
    for key in ("cell_size_m", "thickness_m", "margin_m"):
        lengths.append((f"body.{key}", getattr(study.body, key) or 0.0, LARGEST_BODY_M))
    lengths += [("body.origin_m", abs(value), 3.0) for value in study.body.origin_m]
    lengths += [("map.length_m", study.map.length_m or 0.0, LARGEST_BODY_M)]
    lengths += [("probe.radius_m", study.probe.radius_m, LARGEST_RADIUS_M)]
    lengths += [("noise.displacement_m", study.noise.displacement_m or 0.0, LARGEST_NOISE_M)]
    lengths += [("noise.touch_m", study.noise.touch_m or 0.0, LARGEST_NOISE_M)]
    for table in ("initial", "fixed"):
        for name, value in getattr(study.map, table).items():
            if name.endswith("_m"):
                lengths.append((f"map.{table}.{name}", abs(value), 3.0))
    for key, value, limit in lengths:
        if value > limit:
            raise InputError(
                f"{where}{key}: found {value:g} m, expected at most {limit:g} m; this looks "
                f"like millimetres: divide by 1000 ({escape})"
            )
    for name in ("base_normal_m_per_pa", "base_tangential_m_per_pa"):
        value = getattr(study.body, name) or 0.0
        if value > SOFTEST_BASE_M_PER_PA:
            raise InputError(
                f"{where}body.{name}: found {value:g} m/Pa, expected at most "
                f"{SOFTEST_BASE_M_PER_PA:g} m/Pa; this looks like mm/kPa: multiply by 1e-6 "
                f"({escape})"
            )
    for table in ("initial", "fixed"):
        background = getattr(study.map, table).get("background_pa", inf)
        if background < SOFTEST_BODY_PA:
            raise InputError(
                f"{where}map.{table}.background_pa: found {background:g} Pa, expected at "
                f"least {SOFTEST_BODY_PA:g} Pa; this looks like kilopascals: multiply by 1000 "
                f"({escape})"
            )
        background = getattr(study.map, table).get("background_pa", 0.0)
        if background > HARDEST_BODY_PA:
            raise InputError(
                f"{where}map.{table}.background_pa: found {background:g} Pa, expected at most "
                f"{HARDEST_BODY_PA:g} Pa of a soft body; correct it ({escape})"
            )
    noise = study.noise.force_n or 0.0
    if noise > 2.0:
        raise InputError(
            f"{where}noise.force_n: found {noise:g} N, expected at most 2 N; this looks like "
            f"grams: divide by 101.97 ({escape})"
        )
