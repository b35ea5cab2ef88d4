"""Another scan of a study's body, placed on it."""

from models import InputError, Scan, touching
from palpmap.study.placement import place_scan
from palpmap.study.study import Study

_KEYS = (
    "shape", "size_m", "thickness_m", "poisson_ratio", "support", "base_normal_m_per_pa",
    "base_tangential_m_per_pa", "held_sides", "project_points",
)  # fmt: skip


def other_key(own: Study, other: Study) -> tuple[str, str, str] | None:
    """Return the first key in which two studies state different bodies, and both its values."""
    for key in _KEYS:
        here, there = getattr(own.body, key), getattr(other.body, key)
        if here != there:
            return f"body.{key}", _shown(here), _shown(there)
    return None


def placed_on_body_of(own: Study, other: Study, scan: Scan) -> tuple[Scan, tuple[str, ...]]:
    """Place another study's scan on a study's body; second, sentences about both.

    The other study's `body.origin_m` says where the body stands in the frame of its scan.

    Raises
    ------
    InputError
        The studies state different bodies, or a press does not lie on this one.
    """
    if (found := other_key(own, other)) is not None:
        key, here, there = found
        raise InputError(
            f"{other.scan}: its study has {key} = {there}, the fitted one {here}; expected the "
            "same body: correct one of the studies"
        )
    body = own.body.model_copy(update={"origin_m": other.body.origin_m})
    placed = place_scan(touching(scan), other.model_copy(update={"body": body}))
    notes = []
    left = len(scan.press_ids) - len(placed.scan.press_ids)
    if left:
        notes.append(f"{left} presses met no body and are not predicted.")
    if own.body.shape == "from-contacts":
        notes.append(
            f"Contacts lie up to {1e3 * placed.distance_m.max():.2g} mm off the surface through "
            f"those of the fit, directions up to {placed.angle_deg.max():.2g} degrees off its "
            "normals."
        )
    if other.probe.tip != own.probe.tip:
        raise InputError(
            f'{other.scan}: its study has probe.tip = "{other.probe.tip}", the fitted one '
            f'"{own.probe.tip}"; expected the same shape of tip (its radius may differ)'
        )
    return placed.scan, tuple(notes)


def _shown(value: object) -> str:
    if value is None:
        return "nothing"
    return f'"{value}"' if isinstance(value, str) else str(value)
