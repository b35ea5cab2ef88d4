"""Noise of displacement and force, as given or as estimated from the scan itself.

It is estimated from differences along smooth ramps and not from a fit's residual, which holds the
model's errors too. Along a phase of a press both columns are smooth functions of time (or of the
sample's number); the divided difference of four neighbours removes anything that is quadratic
across them and leaves noise.

True motion in these differences (of a robot that does not move quite smoothly) appears in both
columns at once, in the ratio of the press's compliance C. With the differences D of d and G of F,

    sd_d^2 = var(D) - C cov(D, G)        sd_F^2 = var(G) - cov(D, G) / C
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identify.measurement.settings import NOISE, NoiseSettings
from models import InputError, Scan

_POINTS = 4  # of a third difference


@dataclass(frozen=True)
class Noise:
    """Standard deviation of displacement (m) and force (N), each given or estimated.

    `touch_m` is that of a press's depth of first touch, an error which its readings share;
    `lag_s` that of the lag between the channels, which all readings share.
    """

    displacement_m: float
    force_n: float
    displacement_estimated: bool = False
    force_estimated: bool = False
    touch_m: float = 0.0
    lag_s: float = 0.0

    def __post_init__(self) -> None:
        values = (self.displacement_m, self.force_n)
        for name, what in (
            ("touch_m", "depth of first touch in m"),
            ("lag_s", "lag between force and displacement in s"),
        ):
            if not (np.isfinite(value := getattr(self, name)) and value >= 0):
                raise InputError(
                    f"the noise's {name} must be a number >= 0, found {value}: it is the "
                    f"standard deviation of the {what}"
                )
        if not all(np.isfinite(v) and v >= 0 for v in values) or max(values) == 0:
            raise InputError(
                "the noise must be two numbers >= 0, not both zero, found "
                f"displacement_m = {values[0]}, force_n = {values[1]}: "
                "leave out of [noise] what is unknown, it is then estimated"
            )

    @property
    def estimated(self) -> bool:
        """Whether any of the two was estimated from the scan."""
        return self.displacement_estimated or self.force_estimated

    @property
    def of_readings(self) -> Noise:
        """The noise of each reading alone, without the errors that readings share."""
        return replace(self, touch_m=0.0, lag_s=0.0)


def scan_noise(
    scan: Scan,
    displacement_m: float | None = None,
    force_n: float | None = None,
    touch_m: float | None = None,
    lag_s: float | None = None,
    settings: NoiseSettings = NOISE,
) -> Noise:
    """Return the noise as given; of a reading, a None is estimated from the scan's smooth ramps.

    Raises `InputError` for an estimate from a scan with too few runs of four samples.
    An estimate is at least a millionth of the column's rms, so that weights stay finite.
    """
    if lag_s and not scan.has_time:
        raise InputError(
            "the study states noise.lag_s, but the scan has no time stamps: take the key out, or "
            "give time_s"
        )
    if displacement_m is not None and force_n is not None:
        return Noise(displacement_m, force_n, touch_m=touch_m or 0.0, lag_s=lag_s or 0.0)
    d, f, compliance = _differences(scan)
    least = settings.least_differences
    if len(d) < least:
        raise InputError(
            f"the scan has {len(d)} runs of {_POINTS} samples within a phase of a press, at least "
            f"{least} are needed to estimate its noise: state displacement_m and force_n under "
            "[noise] in the study file"
        )
    variance_d = float(np.mean(d**2)) - _shared(compliance * d * f, settings)
    variance_f = float(np.mean(f**2)) - _shared(d * f / compliance, settings)
    floor_d = settings.floor * float(np.sqrt(np.mean(scan.displacement_m**2)))
    floor_f = settings.floor * float(np.sqrt(np.mean(scan.force_n**2)))
    return Noise(
        max(np.sqrt(max(variance_d, 0.0)), floor_d) if displacement_m is None else displacement_m,
        max(np.sqrt(max(variance_f, 0.0)), floor_f) if force_n is None else force_n,
        displacement_m is None,
        force_n is None,
        touch_m or 0.0,
        lag_s or 0.0,
    )


def _shared(products: np.ndarray, settings: NoiseSettings) -> float:
    """Mean of the products if significant, else 0."""
    # Neighbouring differences share samples: about one in _POINTS is independent.
    error = float(np.std(products)) / np.sqrt(len(products) / _POINTS)
    mean = float(np.mean(products))
    return mean if mean > settings.motion_sigmas * error else 0.0


def _differences(scan: Scan) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normalised third divided differences of d and F, and the compliance of their press."""
    change = np.flatnonzero((np.diff(scan.press) != 0) | (scan.phase[1:] != scan.phase[:-1])) + 1
    timed = scan.has_time and bool(np.all(np.diff(scan.time_s) > 0))
    place = scan.time_s if timed else np.arange(len(scan.press), dtype=float)
    out_d, out_f, out_c = [], [], []
    slope = np.bincount(scan.press_index, scan.force_n * scan.displacement_m) / np.maximum(
        np.bincount(scan.press_index, scan.force_n**2), 1e-300
    )
    for run in np.split(np.arange(len(scan.press)), change):
        if len(run) < _POINTS:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(run, _POINTS)
        weight = _divided_difference(place[windows])
        out_d.append(np.sum(weight * scan.displacement_m[windows], axis=1))
        out_f.append(np.sum(weight * scan.force_n[windows], axis=1))
        out_c.append(np.full(len(windows), slope[scan.press_index[run[0]]]))
    if not out_d:
        return np.empty(0), np.empty(0), np.empty(0)
    return np.concatenate(out_d), np.concatenate(out_f), np.concatenate(out_c)


def _divided_difference(place: np.ndarray) -> np.ndarray:
    """Weights (r, 4) that annul quadratics at places (r, 4), of unit sum of squares."""
    apart = place[:, :, None] - place[:, None, :]
    apart[:, np.arange(_POINTS), np.arange(_POINTS)] = 1.0
    weight = 1.0 / np.prod(apart, axis=2)
    return weight / np.linalg.norm(weight, axis=1, keepdims=True)
