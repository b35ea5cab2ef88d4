"""The signature of an effect's hook: input from the chain, then the parameters by name."""

import inspect
from collections.abc import Mapping

from identify.effects.base import LINKS, Advice, Effect, Hook

GIVEN: Mapping[Hook, tuple[str, ...]] = {
    "body": ("state",),
    "contact": ("readings", "pressing", "force_n", "travel_m"),
    "response": ("readings", "force_n", "travel_m"),
    "force": ("readings", "force_n"),
    "reading": ("readings", "force_n", "travel_m"),
    "touch": ("readings",),
}

_ADVICE = [name for name in vars(Advice) if not name.startswith("_")]


def hook_fault(kind: type[Effect]) -> str | None:
    """Return the fault in the hook of a class of effects, with the line to write; or None."""
    if silent := [name for name in _ADVICE if hasattr(kind, name) and not issubclass(kind, Advice)]:
        return (
            f"gives advice ({', '.join(silent)}) that nobody asks for: write "
            f"class {kind.__name__}(Advice, Effect), after from palpmap import Advice, Effect"
        )
    if len(kind.hooks) != 1:
        return (
            f"has the hooks {', '.join(kind.hooks)}: keep one"
            if kind.hooks
            else (f"has no hook: write one of {', '.join(LINKS)}")
        )
    (hook,) = kind.hooks
    wanted = tuple(p.name for p in kind.parameters)
    right = f"write {hook}({', '.join(('self', *GIVEN[hook], '*', *wanted))})"
    found = list(inspect.signature(getattr(kind, hook)).parameters.values())[1:]
    if any(p.kind is p.VAR_KEYWORD for p in found):
        return f"{hook}() does not name its parameters: {right}"
    if found and found[-1].name == "values" and "values" not in wanted:
        old = ", ".join(["self", *(p.name for p in found)])
        return f"{hook}({old}) is the old form: {right}"
    by_name = {p.name for p in found if p.kind is p.KEYWORD_ONLY}
    loose = [p.name for p in found if p.name in wanted and p.name not in by_name]
    if loose:
        return f"{hook}() takes {', '.join(loose)} by place, not by name alone: {right}"
    missing = [name for name in wanted if name not in by_name]
    if missing:
        return f"{hook}() misses the parameter {', '.join(missing)}: {right}"
    unknown = sorted(by_name - set(wanted))
    if unknown:
        return f"{hook}() takes {', '.join(unknown)}, which is none of its parameters: {right}"
    if len(found) - len(by_name) != len(GIVEN[hook]):
        return f"{hook}() is given {len(GIVEN[hook])} arguments before its parameters: {right}"
    return None
