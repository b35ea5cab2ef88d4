"""A made-up scan for the checks of effects: noisy, with forces at and below zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, Need, Pressing, Values, changes_body
from identify.effects.conformance.settings import CONFORMANCE, ConformanceSettings
from identify.effects.conformance.worked_example import apply
from identify.effects.readings import Readings

_LEVEL = (  # share of the press's force, of its time; 8 rows in, 8 held, 6 out
    *(((i + 1) / 8, (i + 1) / 8, "load") for i in range(8)),
    *((1.0, 1 + (i + 1) / 4, "hold") for i in range(8)),
    *((1 - (i + 1) / 6, 3 + (i + 1) / 6, "unload") for i in range(6)),
)
_BOX_M = ((0.0, 0.0, 0.0), (0.096, 0.096, 0.048))
_MODULUS_PA = 6000.0
_PER_SIDE = 5
_FORCE_NOISE_N = 5e-3


@dataclass(frozen=True)
class ExampleScan:
    """Readings, with all other input of an effect's hook.

    Attributes
    ----------
    readings : m of them
    pressing : of each reading
    travel_m : (m,) the travel of a linear body, from the noisy force
    state : the body
    settings : tolerances of the checks
    """

    readings: Readings
    pressing: Pressing
    travel_m: np.ndarray
    state: BodyState
    settings: ConformanceSettings = CONFORMANCE

    def out(self, effect: Effect, values: Values) -> np.ndarray:
        """Return the output of the effect's hook: (m,), or the features of a body."""
        if changes_body(effect):
            return self.felt(effect.body(self.state, **values))
        return apply(effect, self.readings, self.pressing, self.travel_m, values)

    def plain(self, effect: Effect) -> np.ndarray:
        """Return the same without the effect."""
        if changes_body(effect):
            return self.felt(self.state)
        return self.readings.force_n if "force" in effect.hooks else self.travel_m

    def felt(self, state: BodyState) -> np.ndarray:
        """Return features of a body as numbers; to compare bodies, not to fit them.

        The modulus under each press, a mean weighted with the strain energy of a half-space,
        1 / (distance^2 + a^2)^2; the rest as in the state.
        """
        points, weight = self._samples
        modulus = (_MODULUS_PA + state.added_pa(points)) * state.factor(points)
        share, angle = state.fibre_share, 2 * state.fibre_angle_rad
        turns = np.array([np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)])
        fibres = share * turns * [1, 1, 0.5, 0.5]
        return np.concatenate(
            [
                weight @ modulus / _MODULUS_PA,
                fibres,
                [
                    state.poisson_ratio,
                    state.base_normal_m_per_pa * 1e6,
                    state.base_tangential_m_per_pa * 1e6,
                    (state.skin_factor - 1) * state.skin_thickness_m * 1e3,
                    state.mesh_error_share,
                    state.rigid_tip_share,
                    *np.array(state.shift_m) * 1e3,
                    state.inclusion_shape.edge,
                    *state.inclusion_shape.stretch,
                ],
            ]
        )

    @cached_property
    def _samples(self) -> tuple[np.ndarray, np.ndarray]:
        low, high = np.array(self.state.box_m)
        axes = [low[i] + (high[i] - low[i]) * (np.arange(16) + 0.5) / 16 for i in range(3)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        contacts = self.readings.point_m[self.readings.first]
        radius = self.readings.radius_m[self.readings.first][:, None]
        away = points[None] - contacts[:, None]
        weight = 1 / (np.sum(away**2, axis=2) + radius**2) ** 2
        return points, weight / weight.sum(axis=1, keepdims=True)

    def without_time(self) -> ExampleScan:
        """Return the same without time stamps."""
        return replace(self, readings=replace(self.readings, time_s=None))

    def lacking(self, need: Need) -> ExampleScan:
        """Return the same without one need of effects."""
        r = self.readings
        if need == "time":
            return self.without_time()
        keep = {
            "unloading": r.phase != "unload",
            "hold": r.phase != "hold",
            "several forces": (r.phase == "hold") & (r.peak_force_n > 0.9 * r.largest_force_n),
            "several presses": r.press < 4,
        }[need]
        return self.rows(keep)

    def rows(self, keep: np.ndarray) -> ExampleScan:
        """Return the same with some rows only; presses that lose all are gone."""
        r, p = self.readings, self.pressing
        kept, press = np.unique(r.press[keep], return_inverse=True)
        readings = Readings(
            press=press,
            order=np.argsort(np.argsort(r.order[kept])),
            time_s=None if r.time_s is None else r.time_s[keep],
            phase=r.phase[keep],
            point_m=r.point_m[keep],
            direction=r.direction[keep],
            force_n=r.force_n[keep],
            radius_m=r.radius_m[keep],
        )
        pressing = replace(
            p,
            compliance_m_per_n=p.compliance_m_per_n[keep],
            modulus_pa=p.modulus_pa[keep],
            radius_m=p.radius_m[keep],
        )
        return replace(self, readings=readings, pressing=pressing, travel_m=self.travel_m[keep])


def trial(seed: int = 0, start_s: float = 0.0) -> ExampleScan:
    """25 presses of 22 rows on a soft body with a hard spot, to three forces, pauses at random."""
    rng = np.random.default_rng(seed)
    side = np.linspace(0.012, 0.084, _PER_SIDE)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    presses, rows = len(x), len(_LEVEL)
    press = np.repeat(np.arange(presses), rows)
    level, time, phase = (np.array(column) for column in zip(*_LEVEL, strict=True))
    peak = rng.permutation(np.resize([0.15, 0.2, 0.3], presses))
    start = start_s + np.cumsum(rng.uniform(4.2, 7.0, presses))
    force = np.outer(peak, level).ravel() + rng.normal(0, _FORCE_NOISE_N, presses * rows)
    hard = np.exp(-((x - 0.04) ** 2 + (y - 0.06) ** 2) / (2 * 0.015**2))
    compliance, modulus = 0.015 / (1 + hard), _MODULUS_PA * (1 + 0.8 * hard)
    point = np.column_stack([x, y, np.full(presses, 0.048)])
    readings = Readings(
        press=press,
        order=np.arange(presses),
        time_s=np.add.outer(start, time).ravel(),
        phase=np.tile(phase, presses),
        point_m=point[press],
        direction=np.tile((0.0, 0.0, -1.0), (len(press), 1)),
        force_n=force,
        radius_m=np.full(len(press), 5e-3),
    )
    pressing = Pressing(compliance[press], modulus[press], readings.radius_m.copy(), 0.49, "flat")
    state = BodyState(_BOX_M, 0.47, background_pa=_MODULUS_PA)
    return ExampleScan(readings, pressing, pressing.compliance_m_per_n * force, state)


def ragged(full: ExampleScan, seed: int = 1) -> ExampleScan:
    """Return the scan with rows lost at random, so that presses differ in length."""
    rng = np.random.default_rng(seed)
    keep = rng.random(len(full.readings)) > 0.3
    keep[full.readings.first] = True
    return full.rows(keep)


def arrays_of(case: ExampleScan) -> Sequence[tuple[str, np.ndarray]]:
    """All input arrays of a hook, by name."""
    found = [("travel_m", case.travel_m)]
    for record in (case.readings, case.pressing):
        found += [(k, v) for k, v in vars(record).items() if isinstance(v, np.ndarray)]
    return found
