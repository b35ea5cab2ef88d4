r"""Change of a press's compliance by a thin skin on a half-space, by Hankel transforms.

A skin is thinner than any affordable cell. Under the tip the body is as good as a half-space, on
which a skin changes the compliance by D/E,

    D(a, t, f) = (1 - nu^2)/pi int_0^inf p(xi a)^2 [G(xi) - 1] dxi,

with p the Hankel transform of the tip's pressure (sin x/x for the flat punch,
3 (sin x - x cos x)/x^3 for Hertz), and G the surface displacement under a pressure J0(xi r),
relative to that of the half-space without skin: 1 for long waves, 1/f for short ones. The skin has
thickness t, f times the modulus of the body below it, the same nu, and is bonded. G comes from the
equilibrium of four solutions in the skin and two below (Papkovich-Neuber; Johnson, Contact
Mechanics, Sec. 5.8, has the method). Edges, supports and inclusions are felt through the skin's
stretching; `fem.palpation.skin` has the two together.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from fem.contact.half_space import FLAT, HERTZ, mean_displacement
from fem.errors import MeshError

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)
_REACH = 24.0  # G - 1/f falls like exp(-2 xi t)
_WAVES = 600.0  # beyond xi a, the pressure's square is replaced by its mean over a wave
_THINNEST = 1e-4  # of the tip's radius; a thinner skin acts in proportion to its thickness
_STEP = 1e-30  # of the complex-step derivative


class SkinCompliance(NamedTuple):
    """Change of the compliance of each press by a skin, for E = 1.

    Attributes
    ----------
    value : (j,) D, Pa m/N; divided by the local modulus it is the change of the compliance, m/N
    by_thickness : (j,) dD/dt, Pa/N
    by_factor : (j,) dD/df, Pa m/N
    """

    value: np.ndarray
    by_thickness: np.ndarray
    by_factor: np.ndarray


def skin_compliance(
    radius_m: np.ndarray | float,
    thickness_m: float,
    factor: float,
    poisson_ratio: float,
    profile: int = FLAT,
    beyond_membrane: bool = False,
) -> SkinCompliance:
    """Return the change of presses' compliance by a skin on a half-space of E = 1.

    Parameters
    ----------
    radius_m : (j,) radii of the contacts, m
    thickness_m : of the skin, m, >= 0
    factor : modulus of the skin over that of the body, > 0; 1 is no skin
    poisson_ratio : of both
    profile : `fem.contact.half_space.FLAT` or `HERTZ`
    beyond_membrane : leave out the effect of a membrane of the stiffness t (f - 1) E/(1 - nu^2) on
        waves longer than t; a skin softer than the body (f < 1) does not act as one
    """
    radius = np.atleast_1d(np.asarray(radius_m, float))
    if not (np.isfinite(thickness_m) and thickness_m >= 0 and np.isfinite(factor) and factor > 0):
        raise MeshError(
            f"a skin needs a thickness >= 0 m and a modulus factor > 0, got {thickness_m} m and "
            f"{factor}"
        )
    if profile not in (FLAT, HERTZ) or not (radius > 0).all():
        raise MeshError("a skin's compliance needs radii > 0 and the profile FLAT or HERTZ")
    unique, where = np.unique(radius, return_inverse=True)
    rows = []
    for a in unique:
        thickness = max(thickness_m, _THINNEST * a)
        value, by_t, by_f = _change(a, thickness, factor, poisson_ratio, profile, beyond_membrane)
        if thickness_m < thickness:
            part = thickness_m / thickness
            value, by_t, by_f = part * value, value / thickness, part * by_f
        rows.append((value, by_t, by_f))
    return SkinCompliance(*np.array(rows)[where].T)


@lru_cache(maxsize=64)  # a fit asks again and again
def _change(
    a: float, t: float, f: float, nu: float, profile: int, beyond_membrane: bool
) -> tuple[float, float, float]:
    """Return D with its derivatives by t and f."""
    xi, squares = _waves(a, t, profile)
    whole = mean_displacement(a, nu, profile)

    def change(thickness: complex, factor: complex) -> complex:
        kernel = surface_kernel(xi * thickness, factor, nu) - 1 / factor
        result = (1 / factor - 1) * whole
        if beyond_membrane and f >= 1:
            # Of waves as short as the skin is thick no membrane knows
            long = np.exp(-xi * thickness)
            kernel = kernel - long * membrane_kernel(xi * thickness * (factor - 1), nu)
        return result + np.sum(squares * kernel) * (1 - nu**2) / np.pi

    by_t, by_f = change(t + 1j * _STEP * t, f), change(t, f + 1j * _STEP)
    return by_t.real, by_t.imag / (_STEP * t), by_f.imag / _STEP


def membrane_kernel(stiffness: np.ndarray, poisson_ratio: float) -> np.ndarray:
    """G - 1 of a half-space under a membrane, at values of xi t (f - 1), (w,).

    The membrane holds the surface by a shear E t (f - 1)/(1 - nu^2) xi^2 times its radial
    displacement. For nu = 1/2 a press does not stretch the surface and nothing changes.
    """
    nu = poisson_ratio
    k = stiffness / (1 - nu)  # in units of 2 mu xi, E = 2 mu (1 + nu)
    c = 1 - 2 * nu
    # A (1 + k) + B c = 0 for the shear, A + 2 (1 - nu) B = -1 for the pressure
    b = -(1 + k) / (2 * (1 - nu) * (1 + k) - c)
    a = -1 - 2 * (1 - nu) * b
    return (-a - (3 - 4 * nu) * b) / (2 * (1 - nu)) - 1


def _waves(a: float, t: float, profile: int) -> tuple[np.ndarray, np.ndarray]:
    """Wave numbers xi, and the pressure's squared transform there times quadrature weights."""
    end, split = _REACH / t, _WAVES / a
    # Panels of at most half a wave of the pressure, and of 1/t that grow with xi
    near = min(end, split)
    count = int(np.ceil(near / min(np.pi / (2 * a), 1 / t)))
    edges = np.linspace(0, near, count + 1)
    edges = np.concatenate([near * np.geomspace(1e-4, 1, 9)[:-1] / count, edges])
    if end > split:
        far = np.geomspace(split, end, 1 + int(np.ceil(4 * np.log2(end / split))))
        edges = np.concatenate([edges, far])
    edges = np.unique(edges)
    half = np.diff(edges) / 2
    xi = ((edges[1:] + edges[:-1])[:, None] / 2 + half[:, None] * _NODES).ravel()
    weights = (half[:, None] * _WEIGHTS).ravel()
    x = xi * a
    if profile == FLAT:
        squares, mean = np.sinc(x / np.pi) ** 2, 0.5 / x**2
    else:
        small = x < 0.05
        safe = np.where(small, 1, x)
        wave = 3 * (np.sin(safe) - safe * np.cos(safe)) / safe**3
        squares = np.where(small, 1 - x**2 / 10 + x**4 / 280, wave) ** 2
        mean = 4.5 * (1 + 1 / x**2) / x**4
    return xi, weights * np.where(xi > split, mean, squares)


def surface_kernel(
    wave: np.ndarray, factor: complex, poisson_ratio: float, rigid: bool = False
) -> np.ndarray:
    """G at wave numbers times thickness, xi t (w,); with `rigid` the base does not move.

    Each solution has, in units of 1/(2 mu xi), displacements U (radial) and W (into the body) and
    stresses S = sigma_zz and T = sigma_rz; z is the depth. The growing ones are scaled to 1 at the
    skin's lower face, so that nothing overflows.
    """
    zero = np.zeros_like(wave)
    fade = np.exp(-wave)
    top = [_solution(zero, s, kind, 1 if s < 0 else fade, poisson_ratio) for s, kind in _SOLUTIONS]
    low = [_solution(wave, s, kind, fade if s < 0 else 1, poisson_ratio) for s, kind in _SOLUTIONS]
    size = 4 if rigid else 6
    matrix = np.zeros((len(wave), size, size), np.result_type(fade, factor))
    for k in range(4):
        matrix[:, 0, k], matrix[:, 1, k] = top[k][2], top[k][3]
        matrix[:, 2, k], matrix[:, 3, k] = low[k][0], low[k][1]
        if not rigid:
            matrix[:, 4, k], matrix[:, 5, k] = factor * low[k][2], factor * low[k][3]
    if not rigid:
        for k, kind in enumerate("ab"):
            below = _solution(zero, -1, kind, 1, poisson_ratio)
            for row in range(4):
                matrix[:, 2 + row, 4 + k] = -below[row]
    load = np.zeros((len(wave), size, 1), matrix.dtype)
    load[:, 0, 0] = -1 / factor
    amplitude = np.linalg.solve(matrix, load)[:, :, 0]
    surface = np.sum([amplitude[:, k] * top[k][1] for k in range(4)], axis=0)
    return surface / (2 * (1 - poisson_ratio))


_SOLUTIONS = ((-1, "a"), (-1, "b"), (1, "a"), (1, "b"))  # falling and growing with depth


def _solution(z, s: int, kind: str, e, nu: float) -> tuple:
    """U, W, S, T of a potential e = exp(s z) (kind a) or of Papkovich's z potential (kind b)."""
    if kind == "a":
        return -e + 0 * z, s * e + 0 * z, e + 0 * z, -s * e + 0 * z
    return (
        -z * e,
        (s * z - (3 - 4 * nu)) * e,
        (z - 2 * (1 - nu) * s) * e,
        (1 - 2 * nu - s * z) * e,
    )
