"""Linear viscoelasticity with any number of Prony terms: creep, relaxation, histories.

With Poisson's ratio constant in time, every elastic response of a homogeneously viscoelastic body
is retarded by the same creep function, scaled to the instantaneous answer,

    d(t) = int J(t - s) du(s),         J(t) = 1 + sum_i j_i (1 - exp(-t/kappa_i)),
    E(t)/E(0) = G(t) = 1 - sum_i g_i (1 - exp(-t/tau_i)),     sum_i g_i < 1,

u(t) being what the elastic body would do: C F(t), or any law of F (quasi-linear viscoelasticity,
Fung 1972). Both functions of one material obey int_0^t G(t - s) J(s) ds = t (Ferry, Viscoelastic
Properties of Polymers, 1980, ch. 3), and have as many terms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from fem.errors import SolverError


@dataclass(frozen=True)
class Creep:
    """Creep function J(t) = 1 + sum_i j_i (1 - exp(-t/kappa_i)).

    Attributes
    ----------
    amplitudes : (i,) j_i, 1, not negative
    times_s : (i,) retardation times kappa_i, s, positive
    """

    amplitudes: np.ndarray
    times_s: np.ndarray

    def __post_init__(self) -> None:
        _freeze(self)

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """J at times t (...) s; zero before the load, t < 0."""
        return np.where(np.asarray(t) < 0, 0.0, 1 + _risen(self, t))

    def relaxation(self) -> Relaxation:
        """Relaxation function of the same material.

        With the internal variables q_i, kappa_i dq_i/dt = j_i s - q_i, the stress is s = e -
        sum q_i. At given strain e that is a symmetric system whose eigenvalues are -1/tau.
        """
        v = np.sqrt(self.amplitudes / self.times_s)
        rates, modes = np.linalg.eigh(np.diag(1 / self.times_s) + np.outer(v, v))
        return Relaxation((modes.T @ v) ** 2 / rates, 1 / rates)


@dataclass(frozen=True)
class Relaxation:
    """Relaxation function G(t) = 1 - sum_i g_i (1 - exp(-t/tau_i)).

    Attributes
    ----------
    amplitudes : (i,) g_i, 1, not negative, with a sum below 1 (a solid)
    times_s : (i,) relaxation times tau_i, s, positive
    """

    amplitudes: np.ndarray
    times_s: np.ndarray

    def __post_init__(self) -> None:
        _freeze(self)
        if not self.amplitudes.sum() < 1:
            raise SolverError(
                f"relaxation amplitudes must sum to less than 1, got {self.amplitudes.sum():.4g}: "
                "what relaxes entirely is a fluid, and a press would sink for ever"
            )

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """G at times t (...) s; zero before the strain, t < 0."""
        return np.where(np.asarray(t) < 0, 0.0, 1 - _risen(self, t))

    def creep(self) -> Creep:
        """Creep function of the same material; see `Creep.relaxation`."""
        v = np.sqrt(self.amplitudes / self.times_s)
        rates, modes = np.linalg.eigh(np.diag(1 / self.times_s) - np.outer(v, v))
        return Creep((modes.T @ v) ** 2 / rates, 1 / rates)


def _freeze(terms: Creep | Relaxation) -> None:
    amplitudes = np.atleast_1d(np.array(terms.amplitudes, float))
    times = np.atleast_1d(np.array(terms.times_s, float))
    if amplitudes.ndim != 1 or amplitudes.shape != times.shape:
        raise SolverError("Prony terms need one time for each amplitude")
    if not (np.isfinite(amplitudes).all() and np.isfinite(times).all()):
        raise SolverError("Prony terms must be finite")
    if (amplitudes < 0).any() or (times <= 0).any():
        raise SolverError("Prony amplitudes must not be negative and their times be positive")
    for name, array in (("amplitudes", amplitudes), ("times_s", times)):
        array.setflags(write=False)
        object.__setattr__(terms, name, array)


def _risen(terms: Creep | Relaxation, t: np.ndarray) -> np.ndarray:
    """Sum of a_i (1 - exp(-t/tau_i)) at times (...)."""
    age = np.maximum(np.asarray(t, float), 0)[..., None] / terms.times_s
    return -(terms.amplitudes * np.expm1(-age)).sum(axis=-1)


@dataclass(frozen=True)
class Retarded:
    """A history behind single retardation times, and how it depends on them.

    Attributes
    ----------
    parts : (i, t, ...) int (1 - exp(-(t - s)/tau_i)) du(s)
    by_time : (i, t, ...) its derivative with respect to tau_i, 1/s
    """

    parts: np.ndarray
    by_time: np.ndarray


def retarded(
    history: np.ndarray, times_s: np.ndarray, press: np.ndarray, retardation_s: np.ndarray
) -> Retarded:
    """Convolve histories with 1 - exp(-t/tau_i), exactly where they are piecewise linear.

    Each press has a history of its own: it starts from rest with its first row, as a jump where
    that is not zero, runs straight from row to row, and holds what it has not yet given back when
    the same place is pressed again.

    Parameters
    ----------
    history : (t,) or (t, c) elastic response u (or force, or its derivatives: all is linear in it)
    times_s : (t,) s, not falling within a press; two rows at one time are a jump
    press : (t,) whole number of the press of each row, from 0
    retardation_s : (i,) tau_i, s

    Raises
    ------
    SolverError
        Arrays that do not go together, or a time that runs backwards; the row is named.
    """
    u = np.asarray(history, float)
    time = np.asarray(times_s, float)
    place = np.asarray(press)
    tau = np.atleast_1d(np.asarray(retardation_s, float))
    if u.ndim not in (1, 2) or not u.shape[:1] == time.shape == place.shape:
        raise SolverError("a history needs one time and one press number for each row")
    if place.dtype.kind not in "iu" or (place.size and place.min() < 0):
        raise SolverError("press numbers must be whole and not negative")
    if not (np.isfinite(u).all() and np.isfinite(time).all() and (tau > 0).all()):
        raise SolverError("histories must be finite and retardation times positive")
    columns = np.ascontiguousarray(u.reshape(len(u), -1))
    parts, by_time = (np.empty((len(tau), *columns.shape)) for _ in range(2))
    bad = _retard(parts, by_time, columns, time, place.astype(np.int64), tau)
    if bad >= 0:
        raise SolverError(f"row {bad}: time runs backwards within press {place[bad]}")
    return Retarded(parts.reshape(len(tau), *u.shape), by_time.reshape(len(tau), *u.shape))


def respond(
    terms: Creep | Relaxation, history: np.ndarray, times_s: np.ndarray, press: np.ndarray
) -> np.ndarray:
    """Response int J(t - s) du(s), or with a relaxation int G(t - s) du(s), shape of the history.

    See `retarded` for the arguments.
    """
    sign = 1.0 if isinstance(terms, Creep) else -1.0
    parts = retarded(history, times_s, press, terms.times_s).parts
    return np.asarray(history, float) + sign * np.tensordot(terms.amplitudes, parts, axes=1)


@numba.njit(cache=True, nogil=True)
def _retard(parts, by_time, u, time, press, tau):
    """Recursion of the parts r, exact for a straight line from row to row; a bad row, or -1.

    r <- e r + (1 - e) u_before + (1 - m) (u - u_before), e = exp(-x), m = (1 - e)/x, x = step/tau.
    """
    rows, columns = u.shape
    presses = 0
    for t in range(rows):
        presses = max(presses, press[t] + 1)
    r = np.zeros((presses, len(tau), columns))
    dr = np.zeros((presses, len(tau), columns))
    last = np.full(presses, -1)
    for t in range(rows):
        p = press[t]
        before = last[p]
        last[p] = t
        step = 0.0 if before < 0 else time[t] - time[before]
        if step < 0:
            return t
        for i in range(len(tau)):
            x = step / tau[i]
            decay = np.exp(-x)
            if x > 1e-3:
                lost = 1 + np.expm1(-x) / x  # 1 - m
                slope = (decay - 1 + lost) / x  # dm/dx
            else:  # series, as the differences cancel
                lost = x * (1 / 2 - x * (1 / 6 - x * (1 / 24 - x / 120)))
                slope = -1 / 2 + x * (1 / 3 - x * (1 / 8 - x / 30))
            for c in range(columns):
                old = 0.0 if before < 0 else u[before, c]
                rise = u[t, c] - old
                turn = decay * (r[p, i, c] - old) + rise * slope
                dr[p, i, c] = decay * dr[p, i, c] + turn * x / tau[i]
                r[p, i, c] = decay * r[p, i, c] - np.expm1(-x) * old + lost * rise
                parts[i, t, c] = r[p, i, c]
                by_time[i, t, c] = dr[p, i, c]
    return -1
