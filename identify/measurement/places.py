"""Presses at one place, of one scan or of two."""

from typing import NamedTuple

import numpy as np

from identify.effects.readings import Readings

SAME_PLACE, SAME_DIRECTION = 0.2, 0.97  # tip radii; cosine: a press at the same place
_PRESSED_AGAIN = 0.05  # tip radii: there the body is as stiff to within the readings


class Places(NamedTuple):
    """Contact points and unit directions (j, 3) of presses, and radii (j,) of their tips, in m."""

    point_m: np.ndarray
    direction: np.ndarray
    radius_m: np.ndarray


def shared_places(fitted: Places, predicted: Places) -> np.ndarray:
    """Return the matrix (n, j) of ones where a predicted press stands where a fitted one stood."""
    apart = np.linalg.norm(predicted.point_m[:, None] - fitted.point_m[None], axis=2)
    same = _same(fitted, predicted, SAME_PLACE)
    nearest = np.where(same, apart, np.inf).argmin(axis=1)
    found = np.zeros_like(apart)
    each = np.arange(len(apart))
    found[each, nearest] = same[each, nearest]
    return found


def numbered(places: Places) -> np.ndarray:
    """Return the number (j,) of each press's place, the same where a tip pressed again."""
    first = _same(places, places, _PRESSED_AGAIN).argmax(axis=1)
    return np.unique(first[first], return_inverse=True)[1]


def places_of(readings: Readings) -> Places:
    """Return the places of the presses of some readings."""
    first = readings.first
    return Places(readings.point_m[first], readings.direction[first], readings.radius_m[first])


def disagreement(
    values: np.ndarray, weight: np.ndarray, place: np.ndarray, free: np.ndarray, bound: np.ndarray
) -> float:
    """Return the chi-square by which presses of one place differ in a value.

    Parameters
    ----------
    values, weight : (j,) of the presses, and one over their variances
    place : (j,) number of each press's place
    free : (j, k) changes of the values by k unknowns, which make them as alike as may be
    bound : (m, k) whitened rows that hold the unknowns where they are
    """
    moved = np.column_stack([values, free])
    total = np.column_stack([np.bincount(place, weight * column) for column in moved.T])
    mean = total / np.maximum(np.bincount(place, weight), 1e-30)[:, None]
    rows = np.sqrt(weight)[:, None] * (moved - mean[place])
    short = np.concatenate([rows[:, 0], np.zeros(len(bound))])
    left = np.vstack([rows[:, 1:], bound])
    step = np.linalg.lstsq(left, short, rcond=None)[0]
    return float(np.sum((short - left @ step) ** 2))


def _same(fitted: Places, predicted: Places, within: float) -> np.ndarray:
    """Return the matrix (n, j) of True for a place within so many radii, its direction and tip."""
    apart = np.linalg.norm(predicted.point_m[:, None] - fitted.point_m[None], axis=2)
    turned = predicted.direction @ fitted.direction.T
    same = (apart < within * predicted.radius_m[:, None]) & (turned > SAME_DIRECTION)
    return same & np.isclose(predicted.radius_m[:, None], fitted.radius_m, rtol=1e-3)
