"""Faults that befall the arm or the pressed body themselves, not what the robot reads of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from sim.planted.fault_state import Fault
from sim.robot.contact_coupling import PressedBody


class _JointShock(Fault):
    """A torque of 0.3 to 3 N m acts on one joint for 5 to 50 ms."""

    def prepare(self) -> None:
        self.joint, self.size = int(self.draw.integers(6)), self.uniform(0.3, 3, signed=True)
        self.length_s = self.uniform(0.005, 0.05)

    def joint_torque(self, time_s: float, q: np.ndarray) -> np.ndarray:
        torque = np.zeros_like(q)
        if self.active(time_s) and time_s < self.start_s + self.length_s:
            torque[self.joint] = self.size
        return torque


class _Scene(Fault, ABC):
    """Changes the compiled model for the length of a press."""

    model: Any = None

    def scene(self, model: Any) -> None:
        self.model = model
        self.plain = model.body_mass.copy(), model.dof_frictionloss.copy()

    def prepare(self) -> None:
        self.model.body_mass[:], self.model.dof_frictionloss[:] = self.plain
        if self.on:
            self.change()

    @abstractmethod
    def change(self) -> None:
        """Change the model."""


class _JointFriction(_Scene):
    """Dry friction of 0.2 to 3 N m in every joint."""

    def change(self) -> None:
        self.model.dof_frictionloss[:] = self.uniform(0.2, 3.0)


class _WrongPayload(_Scene):
    """The probe is 0.05 to 1.5 kg heavier."""

    def change(self) -> None:
        self.model.body_mass[self.model.body("probe").id] += self.uniform(0.05, 1.5)


class _Body(Fault):
    body_under: PressedBody

    def body(self, body: PressedBody) -> PressedBody:
        self.body_under = body
        return self

    def displacement(self, press: int, force_n: float) -> float:
        return self.body_under.displacement(press, force_n)

    def tangent(self, press: int, force_n: float) -> float:
        return self.body_under.tangent(press, force_n)


class _TipSlips(_Body):
    """Above 0.1 to 0.25 N the tip slips once, and stands 3 to 10 mm deeper at the same force."""

    def prepare(self) -> None:
        self.at_n, self.by_m, self.slipped = self.uniform(0.1, 0.25), self.uniform(3e-3, 1e-2), 0.0

    def displacement(self, press, force_n):
        if self.on and force_n > self.at_n:
            self.slipped = self.by_m
        return self.body_under.displacement(press, force_n) + self.slipped


class _BodyBroken(_Body):
    """The body answers with no stiffness, a negative one, or no number."""

    def prepare(self) -> None:
        self.at_n = self.uniform(0.02, 0.25)
        self.answer = float(self.draw.choice([0.0, -50.0, np.nan]))

    def tangent(self, press, force_n):
        broken = self.on and force_n > self.at_n
        return self.answer if broken else self.body_under.tangent(press, force_n)


class _BodyMoved(Fault):
    """The body rises by 1 to 4 mm before a press, drops by 2 to 30 mm at any time, or is gone."""

    def prepare(self) -> None:
        kind = self.draw.random()
        self.by_m = -0.1 if kind < 0.2 else -self.uniform(2e-3, 3e-2)
        if kind > 0.6:
            self.by_m, self.start_s = self.uniform(1e-3, 4e-3), -np.inf

    def body_pose(self, time_s: float, press: int) -> np.ndarray:
        return np.array([0.0, 0.0, self.by_m if self.active(time_s) else 0.0])


class _BodyRises(Fault):
    """The body rises by 1 to 4 mm at any time, at 5 to 50 mm/s."""

    def prepare(self) -> None:
        self.by_m = self.uniform(1e-3, 4e-3)
        self.speed_m_per_s = float(np.exp(self.draw.uniform(np.log(5e-3), np.log(5e-2))))

    def body_pose(self, time_s: float, press: int) -> np.ndarray:
        risen = self.speed_m_per_s * (time_s - self.start_s) if self.active(time_s) else 0.0
        return np.array([0.0, 0.0, min(risen, self.by_m)])


ARM_AND_BODY_FAULTS: dict[str, type[Fault]] = {
    "joint_shock": _JointShock,
    "joint_friction": _JointFriction,
    "wrong_payload": _WrongPayload,
    "tip_slips": _TipSlips,
    "body_broken": _BodyBroken,
    "body_moved": _BodyMoved,
    "body_rises": _BodyRises,
}
