r"""Travel of a rigid sphere on a body whose compliance under small contacts is known.

Once a contact of radius a is assumed, the body is linear. Its compliance under a contact of that
radius is the half-space's plus what supports, sides and the map of the modulus add,

    C(a) = k c(a) + D(a),    k = (1 - nu^2)/E at the contact point,
    D(a) = l ln(a/a_0) + sum_i D_i a^i,    l = (2 - nu)/(2 (1 - nu)) k E'/(pi E).

The logarithm comes from a modulus that rises with depth at the slope E'; a_0 is any length. For a
force F the contact takes the radius of least complementary energy, and the travel of the sphere is
its derivative (stationary in a, so that only the explicit F counts):

    P(a) = F^2 C(a)/2 + F m(a),    dP/da = 0,    d = dP/dF = F C(a) + m(a).

The pressure is the one that a sphere of radius R has on a half-space, with
g(s) = (s/2) ln((R + s)/(R - s)), phi(s) = g(a) - g(s) and I_n = int_0^a phi^n ds:

    c(a) = I_2/(2 I_1^2),    m(a) = g(a) - I_2/I_1      (Sneddon, Int. J. Eng. Sci. 3, 1965),

so that the half-space is met exactly, F = 2 I_1/k and d = g(a), up to a -> R. For a << R,
c = 0.6/a and m = a^2/(5 R): Hertz. With D constant the contact is Hertz' whatever D is, and

    d = a^2/R + F D_0,    a^3 = 3 F R k/4.

Measured (travel, contact radius up to 0.6 R): with D from Hertz compliances at radii of 0.7, 0.35
and 0.175 R within 0.1 % of the exact contact of a bonded layer for a/h < 0.3, 0.6 % for a/h < 0.6
(nu = 0.3 to 0.5). Two radii, with the logarithm, are within 0.7 % of three where the modulus
changes by a tenth per millimetre, 2.4 % over small hard places at the surface. With D_0 from one
flat tip the body has to be nearly even under the tip: 0.15 % there, but 3 to 13 % over steep maps.

There is no adhesion and no friction: unloading follows the same law.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_GAUSS, _WEIGHTS = (_GAUSS + 1) / 2, _WEIGHTS / 2
_ROUNDS = 60
_FLAT_TO_HERTZ = -0.25  # mean of ln |x - y| under two Hertz pressures less under two flat ones
_WIDEST = 0.995  # largest contact radius, in radii of the sphere


class SphereTravel(NamedTuple):
    """What a sphere does under given forces; m samples, n coefficients of D.

    Attributes
    ----------
    travel_m : (m,) d
    radius_m : (m,) a of the contact
    slope : (m,) dd/dF, m/N
    d_near : (m,) dd/dk, N/m
    d_far : (m, n) dd/dD_i at constant k
    d_radius : (m,) dd/dR
    d_log : (m,) dd/dl
    """

    travel_m: np.ndarray
    radius_m: np.ndarray
    slope: np.ndarray
    d_near: np.ndarray
    d_far: np.ndarray
    d_radius: np.ndarray
    d_log: np.ndarray


def depth_logarithm(near: np.ndarray, slope: np.ndarray, poisson_ratio: float) -> np.ndarray:
    """Factor l of the logarithm in D, m/N.

    Parameters
    ----------
    near : k = (1 - nu^2)/E at the contact points, m^2/N
    slope : E'/E, relative slope of the modulus with depth there, 1/m
    """
    return (2 - poisson_ratio) / (2 * (1 - poisson_ratio)) / np.pi * near * slope


def far_from_flat(
    compliance: np.ndarray, radius_m: np.ndarray, near: np.ndarray, log: np.ndarray | float = 0.0
) -> np.ndarray:
    """D_0 from the compliance of a flat tip, (j, 1) m/N; the logarithm is from that radius.

    Parameters
    ----------
    compliance, radius_m : (j,) m/N and m, of the flat tip
    near, log : (j,) k and l
    """
    far = np.asarray(compliance) - 0.5 * np.asarray(near) / radius_m + _FLAT_TO_HERTZ * log
    return np.atleast_1d(far)[:, None]


def far_coefficients(
    radii_m: np.ndarray,
    compliance: np.ndarray,
    near: np.ndarray,
    log: np.ndarray | float = 0.0,
    log_radius_m: float = 1.0,
    count: int | None = None,
) -> np.ndarray:
    """D_i of presses from their compliances under Hertz' pressure at a few contact radii.

    Parameters
    ----------
    radii_m : (r,) from the widest contact that is expected down to a third of it or so
    compliance : (j, r) m/N
    near, log : (j,) k and l
    count : of coefficients, default r; fewer are fitted.

    Returns
    -------
    (j, count) m/(N m^i)
    """
    radii = np.asarray(radii_m, float)
    k, known = (np.atleast_1d(v)[:, None] for v in (near, log))
    excess = np.atleast_2d(compliance) - 0.6 * k / radii - known * np.log(radii / log_radius_m)
    powers = (radii / radii.max())[:, None] ** np.arange(count or len(radii))
    scaled = np.linalg.lstsq(powers, excess.T, rcond=None)[0]
    return (scaled / radii.max() ** np.arange(len(scaled))[:, None]).T


def sphere_travel(
    force_n: np.ndarray,
    radius_m: float,
    near: np.ndarray,
    far: np.ndarray,
    log: np.ndarray | float = 0.0,
    log_radius_m: float = 1.0,
    smallest_n: float = 1e-4,
) -> SphereTravel:
    """Travel of a sphere under each force.

    Parameters
    ----------
    force_n : (m,) pressing positive
    radius_m : R
    near : (m,) or one number, k = (1 - nu^2)/E at the contact point, m^2/N
    far : (m, n) or (n,), D_i, m/(N m^i)
    log, log_radius_m : (m,) or one number, l in m/N, and a_0
    smallest_n : below it the travel is the line to the origin, for negative forces too: dd/dF of a
        sphere is infinite at first touch, where a measured force is mostly noise.

    Raises
    ------
    ValueError
        A force that would push the sphere in to its equator; the sample is named.

    Examples
    --------
    Hertz, d^3 = (3 k F/4)^2/R:

    >>> found = sphere_travel(np.array([0.01]), 0.1, 1e-4, np.array([0.0]))
    >>> round(float(found.travel_m[0]) / ((0.75e-6) ** 2 / 0.1) ** (1 / 3), 3)
    1.0
    """
    given = np.atleast_1d(np.asarray(force_n, float))
    force = np.maximum(given, smallest_n)
    near = np.broadcast_to(np.asarray(near, float), force.shape)
    far = np.asarray(far, float)
    far = np.broadcast_to(far, (len(force), far.shape[-1]))
    log = np.broadcast_to(np.asarray(log, float), force.shape)
    body = _Body(near, far, log, log_radius_m)
    if not (radius_m > 0 and smallest_n > 0 and (near > 0).all()):
        raise ValueError("the sphere's radius, the near compliance and smallest_n must be positive")
    a = _contact_radius(force, radius_m, body)
    state = _state(a, force, radius_m, body)
    travel = force * state.compliance + state.m
    # Implicit function: r(a; F, k, D, R) = F C'/2 + m' = 0, and dd/da = F C' + m' = F C'/2
    half = force * state.d_compliance / 2
    lever = -half / state.d_residual  # dd/da over -dr/da
    slope = state.compliance + lever * state.d_compliance / 2
    d_near = force * (state.c + lever * state.dc / 2)
    d_far = force[:, None] * (state.powers + lever[:, None] * state.d_powers / 2)
    d_log = force * (np.log(a / log_radius_m) + lever / (2 * a))
    # Lengths scale together: d is homogeneous of degree 1 if R, a_0 have degree 1, k 2, l 1 and
    # D_i 1 - i; a_0 only moves D_0
    share = 1 - np.arange(far.shape[1])
    d_radius = (travel - 2 * near * d_near - np.sum(share * far * d_far, axis=1)) / radius_m
    d_radius -= log * (d_log - d_far[:, 0]) / radius_m
    low = given < smallest_n
    line = np.where(low, given / force, 1.0)
    return SphereTravel(
        travel * line,
        np.where(given > 0, a, 0.0),
        np.where(low, travel / force, slope),
        d_near * line,
        d_far * line[:, None],
        d_radius * line,
        d_log * line,
    )


class _Body(NamedTuple):
    """k (m,), D_i (m, n), l (m,) and a_0."""

    near: np.ndarray
    far: np.ndarray
    log: np.ndarray
    log_radius: float


def _contact_radius(force, radius: float, body: _Body) -> np.ndarray:
    """Where the complementary energy is least: Newton steps kept in a bracket."""
    low, high = np.zeros(len(force)), np.full(len(force), _WIDEST * radius)
    beyond = _state(high, force, radius, body).residual < 0
    if beyond.any():
        worst = int(np.argmax(np.where(beyond, force, -np.inf)))
        raise ValueError(f"sample {worst}: {force[worst]:.3g} N pushes a sphere of radius "
                         f"{radius:.3g} m in to its equator")  # fmt: skip
    a = np.minimum(np.cbrt(0.75 * force * radius * body.near), 0.9 * radius)
    for _ in range(_ROUNDS):
        state = _state(a, force, radius, body)
        inside = state.residual < 0
        low, high = np.where(inside, a, low), np.where(inside, high, a)
        step = a - state.residual / state.d_residual
        step = np.where((step > low) & (step < high), step, (low + high) / 2)
        settled = np.abs(step - a) <= 1e-14 * radius + 1e-13 * a
        a = step
        if settled.all():
            break
    return a


class _State(NamedTuple):
    """Compliance C, work m and r = F C'/2 + m' at a contact radius, with slopes in a."""

    c: np.ndarray
    dc: np.ndarray
    m: np.ndarray
    compliance: np.ndarray
    d_compliance: np.ndarray
    residual: np.ndarray
    d_residual: np.ndarray
    powers: np.ndarray
    d_powers: np.ndarray


def _state(a, force, radius: float, body: _Body) -> _State:
    near, far, log = body.near, body.far, body.log
    g, dg, ddg = _shift(a, radius)
    phi = g[:, None] - _shift(a[:, None] * _GAUSS, radius)[0]
    i1, i2 = a * (phi @ _WEIGHTS), a * (phi**2 @ _WEIGHTS)
    # I_1' = a g', I_2' = 2 g' I_1; q = a I_2/I_1^2 (1.2 for Hertz)
    q = a * i2 / i1**2
    dq = q / a - 2 * a * dg / i1 * (q - 1)
    dc = -dg / i1 * (q - 1)
    ddc = -(ddg - a * dg**2 / i1) / i1 * (q - 1) - dg / i1 * dq
    dm, ddm = dg * (q - 1), ddg * (q - 1) + dg * dq
    order = np.arange(far.shape[1])
    powers = a[:, None] ** order
    d_powers = order * a[:, None] ** np.maximum(order - 1, 0)
    dd_powers = order * (order - 1) * a[:, None] ** np.maximum(order - 2, 0)
    compliance = near * q / (2 * a) + np.sum(far * powers, axis=1)
    compliance += log * np.log(a / body.log_radius)
    d_compliance = near * dc + np.sum(far * d_powers, axis=1) + log / a
    dd_compliance = near * ddc + np.sum(far * dd_powers, axis=1) - log / a**2
    return _State(
        q / (2 * a),
        dc,
        g - i2 / i1,
        compliance,
        d_compliance,
        force * d_compliance / 2 + dm,
        force * dd_compliance / 2 + ddm,
        powers,
        d_powers,
    )


def _shift(s: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """g(s) and its first two derivatives."""
    log = np.log1p(2 * s / (radius - s))
    rest = radius**2 - s**2
    return s / 2 * log, log / 2 + s * radius / rest, 2 * radius**3 / rest**2
