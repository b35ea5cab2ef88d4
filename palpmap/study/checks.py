"""Scans that no fit can make anything of, each refused in a sentence."""

import numpy as np

from identify import FEWEST_PRESSES, different_presses
from models import InputError, Scan
from palpmap.study.body_model import points_of
from palpmap.study.placement import Placement
from palpmap.study.study import Study

_STEADY, _MOVED = 0.95, 0.2  # of the press's largest force and travel


def refuse_unfit(placement: Placement, study: Study) -> None:
    """Refuse a placed scan that cannot determine the study's map, or contradicts itself.

    Raises
    ------
    InputError
        Fewer different presses than the map has unknowns; a tip deeper than the body is high; a
        force that stays the same while the tip goes in.
    """
    refuse_contradictions(placement, study)
    if said := too_few(placement, study):
        raise InputError(f"{study.scan}: {said}")


def refuse_contradictions(placement: Placement, study: Study) -> None:
    """Refuse a placed scan that contradicts itself or the study, however many presses it has."""
    _refuse_tip(study)
    _refuse_outside(study)
    _refuse_steady(placement.scan.used(), study)
    _refuse_too_deep(placement.scan, study)


def too_few(placement: Placement, study: Study) -> str | None:
    """Name the missing data where the presses cannot determine the study's map, else None."""
    scan = placement.scan.used()
    uncounted = study.map.kind == "free" or study.map.inclusions == "auto"
    number = 0 if uncounted else int(study.map.inclusions)
    unknowns = 1 + 5 * number - len(study.map.fixed)
    found = different_presses(scan)
    if found >= unknowns and len(scan.press_ids) >= FEWEST_PRESSES:
        return None
    inclusions = "1 inclusion" if number == 1 else f"{number} inclusions"
    why = f", as many as a map with {inclusions} has unknowns" if unknowns > FEWEST_PRESSES else ""
    fewer = ", or state fewer inclusions (map.inclusions = 0 has none)" if number else ""
    return (
        f"found {found} different press{'es' if found > 1 else ''} (place, direction or tip "
        f"radius), expected at least {max(unknowns, FEWEST_PRESSES)}{why}; press at more "
        f"places{fewer}"
    )


def _refuse_tip(study: Study) -> None:
    """Refuse a tip of which the model knows no contact."""
    if study.probe.tip not in ("flat", "sphere"):
        raise InputError(
            f'{study.scan}: its study has probe.tip = "{study.probe.tip}", expected "flat" or '
            '"sphere", the contacts that the model knows; a scan by another tip cannot be fitted'
        )


def _refuse_outside(study: Study) -> None:
    """Refuse an inclusion that is stated larger than the body, or beside it."""
    if not any(name.startswith("inclusion_") for name in (*study.map.initial, *study.map.fixed)):
        return
    box_m = points_of(study.body)[1]
    for table in ("initial", "fixed"):
        given = getattr(study.map, table)
        for name, value in given.items():
            inclusion, _, key = name.rpartition(".")
            if key == "radius_m":
                refuse_wide(f"study, key map.{table}.{name}", value, box_m)
            axis = ("x_m", "y_m", "z_m").index(key) if key in ("x_m", "y_m", "z_m") else None
            if axis is None:
                continue
            radius = {**study.map.initial, **study.map.fixed}.get(f"{inclusion}.radius_m", 0.0)
            low, high = box_m[:, axis] + study.body.origin_m[axis]
            if not low - radius <= value <= high + radius:
                raise InputError(
                    f"study, key map.{table}.{name}: found {value:g} m, expected {low:g} to "
                    f"{high:g} m, inside the body in the scan's frame (body.origin_m and "
                    "its size); correct the place, or leave it out to have it found"
                )


def refuse_wide(where: str, radius_m: float, box_m: np.ndarray) -> None:
    """Refuse an inclusion whose radius is more than the longest edge of the body's box (2, 3)."""
    longest = float(np.ptp(box_m, axis=0).max())
    if radius_m > longest:
        raise InputError(
            f"{where}: found {radius_m:g} m, expected at most {longest:g} m, the body's longest "
            "edge: a wider spot is the same everywhere; correct it, or change the background"
        )


def _refuse_too_deep(scan: Scan, study: Study) -> None:
    size = study.body.size_m
    if size is None or study.body.thickness_assumed:
        return
    row = int(np.argmax(np.where(scan.in_contact, scan.displacement_m, -np.inf)))
    if scan.displacement_m[row] >= size[2]:
        raise InputError(
            f"{study.scan}, row {row + 1} (press {scan.press[row]}), column displacement_m: found "
            f"{scan.displacement_m[row]:.4g} m, expected less than the body's height of "
            f"{size[2]:g} m (body.size_m); this looks like centimetres (divide by 100) or "
            "millimetres (divide by 1000), else correct the height"
        )


def _refuse_steady(scan: Scan, study: Study) -> None:
    def extremes(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        low = np.full(len(scan.press_ids), np.inf)
        high = -low
        np.minimum.at(low, scan.press_index, values)
        np.maximum.at(high, scan.press_index, values)
        return low, high

    (weakest, strongest), (least, most) = extremes(scan.force_n), extremes(scan.displacement_m)
    steady = (weakest > _STEADY * strongest) & (least < _MOVED * most)
    if np.mean(steady) > 0.5:
        j = int(steady.argmax())
        raise InputError(
            f"{study.scan}, press {scan.press_ids[j]}: force_n stays at {strongest[j]:.4g} N while "
            f"displacement_m goes from {least[j]:.4g} to {most[j]:.4g} m, and so in most presses; "
            "expected the force that was measured at each reading, not the one that was set"
        )
