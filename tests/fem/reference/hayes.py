r"""Frictionless contact of a rigid round tip with a bonded elastic layer, to machine accuracy.

The pressure is a superposition of flat punches of radius s <= a (Hayes, Keer, Herrmann & Mockros,
J. Biomech. 5, 1972; Sneddon, Int. J. Eng. Sci. 3, 1965): with phi(s) its density, r p(r) has the
Hankel transform (1/2 pi) int phi(s) cos(xi s) ds, the force is int phi ds, and contact with a tip
of profile f(r) means, for 0 < s < a and k = (1 - nu^2)/E,

    k [phi(s)/2 + (1/pi) int_0^a L(s, t) phi(t) dt] = d - g(s),
    L(s, t) = int_0^inf (M(xi h) - 1) cos(xi s) cos(xi t) dxi,
    M(x) = ((3 - 4 nu) sinh 2x - 2x)/((3 - 4 nu) cosh 2x + 2x^2 + 5 - 12 nu + 8 nu^2).

g(s) = d/ds int_0^s f(r) r/sqrt(s^2 - r^2) dr is 0 for the flat tip and (s/2) ln((R + s)/(R - s))
for a sphere of radius R (s^2/R for the paraboloid). A tip without an edge ends where phi(a) = 0.
The half-space is h = inf. Incompressible layers (nu = 0.5) are no exception.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

_POINTS = 48  # on 0 < s < a
_DECAY = 24.0  # M - 1 < 1e-17 beyond this argument


class LayerContact(NamedTuple):
    """Equilibrium of a round tip on a layer.

    Attributes
    ----------
    force_n, travel_m, radius_m : of the tip, and of the contact
    s_m, density : (48,) the superposition phi(s), N/m
    """

    force_n: float
    travel_m: float
    radius_m: float
    s_m: np.ndarray
    density: np.ndarray


def layer_transfer(x: np.ndarray, poisson_ratio: float) -> np.ndarray:
    """M(x): surface compliance of the bonded layer over the half-space's at wave number x/h."""
    nu, x = poisson_ratio, np.asarray(x, float)
    c, decay = 3 - 4 * nu, np.exp(-2 * x)  # everything times 2 exp(-2x), which cannot overflow
    return (c * (1 - decay**2) - 4 * x * decay) / (
        c * (1 + decay**2) + 2 * (2 * x**2 + 5 - 12 * nu + 8 * nu**2) * decay
    )


def sphere_shift(s: np.ndarray, radius_m: float) -> np.ndarray:
    """g(s) of a rigid sphere, m: the travel at which its contact on a half-space has radius s."""
    return s / 2 * np.log((radius_m + s) / (radius_m - s))


def layer_operator(
    radius: float, thickness: float, nu: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points s, their weights and the matrix of phi/2 + (1/pi) int L phi."""
    x, w = np.polynomial.legendre.leggauss(_POINTS)
    s, w = radius * (x + 1) / 2, radius * w / 2
    if np.isinf(thickness):
        return s, w, np.eye(len(s)) / 2
    panels = max(4, int(4 * radius / thickness))  # the cosines turn faster under a wider tip
    edges = np.linspace(0, _DECAY, panels + 1)
    wave = (edges[:-1, None] + np.diff(edges)[:, None] * (x + 1) / 2).ravel()
    weight = np.tile(np.diff(edges)[0] * np.polynomial.legendre.leggauss(_POINTS)[1] / 2, panels)
    cosine = np.cos(np.outer(s, wave / thickness))
    kernel = (cosine * (weight / thickness * (layer_transfer(wave, nu) - 1))) @ cosine.T
    return s, w, np.eye(len(s)) / 2 + kernel * w / np.pi


def punch_factor(radius_over_thickness: float, poisson_ratio: float) -> float:
    """Stiffness kappa of a flat punch on a bonded layer over the half-space's (Hayes, eq. 13).

    F = 2 E a d kappa/(1 - nu^2).

    Examples
    --------
    >>> round(punch_factor(1.0, 0.5), 4)
    3.6187
    """
    _, w, operator = layer_operator(radius_over_thickness, 1.0, poisson_ratio)
    return float(w @ np.linalg.solve(operator, np.ones(len(w)))) / (2 * radius_over_thickness)


def sphere_on_layer(
    contact_radius_m: float,
    tip_radius_m: float,
    modulus_pa: float,
    poisson_ratio: float,
    thickness_m: float = np.inf,
    paraboloid: bool = False,
) -> LayerContact:
    """Force and travel of a rigid sphere whose contact has the given radius.

    Parameters
    ----------
    thickness_m : of the bonded layer; inf is the half-space.
    paraboloid : of the same curvature instead of the sphere (Hertz' assumption).
    """
    a, tip = contact_radius_m, tip_radius_m
    if not 0 < a < (np.inf if paraboloid else tip):
        raise ValueError(f"a contact of radius {a:.3g} m does not fit a sphere of {tip:.3g} m")
    s, w, operator = layer_operator(a, thickness_m, poisson_ratio)
    x = np.append(s, a)
    shift = x**2 / tip if paraboloid else sphere_shift(x, tip)
    even, bent = np.linalg.solve(operator, np.column_stack([np.ones(len(s)), shift[:-1]])).T
    # phi at the edge from the equation itself, phi(a)/2 = d - g(a) - (1/pi) int L(a, t) phi dt
    edge = _edge_row(s, w, a, thickness_m, poisson_ratio)
    travel = (shift[-1] - edge @ bent) / (1 - edge @ even)
    density = modulus_pa / (1 - poisson_ratio**2) * (travel * even - bent)
    return LayerContact(float(w @ density), float(travel), a, s, density)


def _edge_row(s, w, a: float, thickness: float, nu: float) -> np.ndarray:
    """(1/pi) L(a, t) times the weights of t."""
    if np.isinf(thickness):
        return np.zeros(len(s))
    wave, weight = np.polynomial.legendre.leggauss(400)
    wave, weight = _DECAY * (wave + 1) / 2, _DECAY * weight / 2
    shape = weight / thickness * (layer_transfer(wave, nu) - 1) * np.cos(wave * a / thickness)
    return shape @ np.cos(np.outer(wave / thickness, s)) * w / np.pi


def press_layer(
    force_n: float,
    tip_radius_m: float,
    modulus_pa: float,
    poisson_ratio: float,
    thickness_m: float = np.inf,
    paraboloid: bool = False,
) -> LayerContact:
    """As `sphere_on_layer`, for a given force.

    Raises
    ------
    ValueError
        A force that would push the sphere in to its equator.
    """
    arguments = (tip_radius_m, modulus_pa, poisson_ratio, thickness_m, paraboloid)
    hertz = np.cbrt(0.75 * force_n * tip_radius_m * (1 - poisson_ratio**2) / modulus_pa)
    low, high = 1e-3 * hertz, 1.5 * hertz if paraboloid else 0.999 * tip_radius_m
    if sphere_on_layer(high, *arguments).force_n < force_n:
        raise ValueError(f"{force_n:.3g} N pushes the sphere in to its equator")
    radius = brentq(lambda a: sphere_on_layer(a, *arguments).force_n - force_n, low, high)
    return sphere_on_layer(float(radius), *arguments)  # pyright: ignore[reportArgumentType]
