"""Hidden heights of the surface, of which the robot, counting from a plane, knows nothing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.polynomial import legendre

from sim.planted.bench import Bench
from sim.planted.effect import any_axis, on_sensor

SURFACE = ("surface_tilt", "curved_surface", "uneven_surface", "surface_bump")
_DEGREE = 4


def places(bench: Bench) -> np.ndarray:
    """Contact points (j, 2) from the body's middle, in half widths of the body."""
    half = np.array(bench.body.size_m[:2]) / 2
    return (bench.points_m - half) / half.max()


def bow(bench: Bench, values: Mapping[str, float]) -> np.ndarray:
    """Height (j,) of a bow along one direction, with a share of it across; 1 at the edge."""
    angle = values["angle_rad"]
    across = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    along, aside = (places(bench) @ across).T
    return along**2 + values["ratio"] * aside**2


def _bow(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    return {**any_axis(bench, rng), "ratio": float(rng.uniform(-1, 1))}


@on_sensor("structured", "travel + height (s^2 + ratio r^2), s along and r across", "height_m",
           1.5e-4, two_sided=True, draw=_bow)  # fmt: skip
def curved_surface(bench, force_n, travel_m, values):
    """The surface bows: a dome, a trough or a saddle, and travel counts from the plane."""
    return force_n, travel_m + values["height_m"] * bow(bench, values)[:, None]


def _terms(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    """Draw amplitudes of all terms up to the fourth degree, smaller for higher degrees."""
    degrees = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i) if i + j]
    return {f"c_{i}{j}": float(rng.normal() / (i + j)) for i, j in degrees}


def terrain(bench: Bench, values: Mapping[str, float]) -> np.ndarray:
    """Height (j,) of a sum of Legendre's polynomials."""
    table = np.zeros((_DEGREE + 1, _DEGREE + 1))
    for name, size in values.items():
        if name.startswith("c_"):
            table[int(name[2]), int(name[3])] = size
    x, y = places(bench).T
    return legendre.legval2d(x, y, table)


@on_sensor("structured", "travel + height sum of c_ij P_i(x) P_j(y), i + j <= 4", "height_m",
           1e-4, draw=_terms)  # fmt: skip
def uneven_surface(bench, force_n, travel_m, values):
    """The surface has hills and dents, and travel counts from the plane."""
    return force_n, travel_m + values["height_m"] * terrain(bench, values)[:, None]


def mound(bench: Bench, values: Mapping[str, float]) -> np.ndarray:
    """Height (j,) of a round bump that ends at its radius."""
    away = np.hypot(*(places(bench) - (values["x"], values["y"])).T) / values["radius"]
    return np.where(away < 1, 0.5 * (1 + np.cos(np.pi * away)), 0.0)


def _mound(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    x, y = rng.uniform(-0.5, 0.5, 2)
    return {"x": float(x), "y": float(y), "radius": float(rng.uniform(0.5, 1.1))}


@on_sensor("structured", "travel + height (1 + cos(pi r/radius))/2 where r < radius", "height_m",
           2e-4, two_sided=True, draw=_mound)  # fmt: skip
def surface_bump(bench, force_n, travel_m, values):
    """The surface has one hill or dent, and travel counts from the plane."""
    return force_n, travel_m + values["height_m"] * mound(bench, values)[:, None]


# ---- by laws that no catalogue has ---------------------------------------------------------


def bump(bench: Bench, values: Mapping[str, float]) -> np.ndarray:
    """Height (j,) of a hill."""
    away = places(bench) - (values["x"], values["y"])
    return np.exp(-np.sum(away**2, axis=1) / (2 * values["width"] ** 2))


def _bump(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    x, y = rng.uniform(-0.4, 0.4, 2)
    return {"x": float(x), "y": float(y), "width": float(rng.uniform(0.3, 0.6))}


@on_sensor("form", "travel + height exp(-r^2/(2 width^2))", "height_m", 2e-4, two_sided=True,
           kin=SURFACE, draw=_bump)  # fmt: skip
def form_hill_of_the_surface(bench, force_n, travel_m, values):
    """A hill or a dent that the planned surface does not have."""
    return force_n, travel_m + values["height_m"] * bump(bench, values)[:, None]


def wave(bench: Bench, values: Mapping[str, float]) -> np.ndarray:
    """Height (j,) of a sine along a direction."""
    angle = values["angle_rad"]
    along = places(bench) @ (np.cos(angle), np.sin(angle))
    return np.sin(2 * np.pi * along / values["length"] + values["phase_rad"])


def _wave(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    phase = float(rng.uniform(0, 2 * np.pi))
    return {**any_axis(bench, rng), "length": float(rng.uniform(1.6, 3)), "phase_rad": phase}


@on_sensor("form", "travel + height sin(2 pi s/length + phase)", "height_m", 1.5e-4, kin=SURFACE,
           draw=_wave)  # fmt: skip
def form_wavy_surface(bench, force_n, travel_m, values):
    """The skin lies in a fold."""
    return force_n, travel_m + values["height_m"] * wave(bench, values)[:, None]


def rim(bench: Bench, values: Mapping[str, float]) -> np.ndarray:
    """Height (j,) of a meniscus, negative: travel ends early where the body creeps up its mould."""
    from_wall = 1 - np.abs(places(bench)).max(axis=1)
    return -np.exp(-np.maximum(from_wall, 0) / values["width"])


def _rim(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    return {"width": float(rng.uniform(0.3, 0.6))}


@on_sensor("form", "travel - height exp(-way from the wall/width)", "height_m", 3e-4, kin=SURFACE,
           draw=_rim)  # fmt: skip
def form_raised_rim(bench, force_n, travel_m, values):
    """A cast body that crept up the walls of its mould."""
    return force_n, travel_m + values["height_m"] * rim(bench, values)[:, None]


FORMS_OF_THE_SURFACE = (form_hill_of_the_surface, form_wavy_surface, form_raised_rim)
