"""Values from which an effect's fit starts, as a study states them."""

from identify.effects.base import Effect, Values
from models import nearest


def lacking_in(effect: Effect, initial: Values) -> str | None:
    """Return the values expected where `initial` has unknown, missing or impossible ones.

    Bounds that a scan and its body set (`Effect.bounded`) are not known here.
    """
    names = [p.name for p in effect.parameters]
    values = f"values of {', '.join(names)} under initial of '{effect.name}'"
    for name in initial:
        if name not in names:
            return f"{values}, not of '{name}'{nearest(name, tuple(names))}"
    bounds_known = type(effect).bounded is Effect.bounded
    for p in effect.parameters if initial else ():
        if p.name not in initial:
            return f"{values}; {p.name} is missing"
        value, slack = initial[p.name], 1e-9 * abs(initial[p.name])
        if bounds_known and not p.lower - slack <= value <= p.upper + slack:
            unit = "" if p.unit == "1" else f" {p.unit}"
            return (
                f"initial.{p.name} of '{effect.name}' from {p.lower:g} to {p.upper:g}{unit}, not "
                f"{value:g}{unit}"
            )
    return None
