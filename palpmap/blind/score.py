"""Judging an explanation against the hidden effect: right, honest, missed or wrong.

| hidden | passes if |
|---|---|
| nothing | the verdict is `nothing_missing` |
| a structured effect | it, or another form of its family, is named first |
| a compliance-like effect | it is named first, or in an ambiguous group of at most three, or is \
smaller than the detection limit that was printed |
| two effects | both are named |
| a foreign form of an effect | an effect of its family is named first; honest is \
`nothing_missing` below the limits of all of them |
| an outsider | the verdict is not `explained` |
"""

from palpmap.blind.records import AnswerRecord, MapErrorRecord, Outcome, ScoreRecord
from palpmap.result.truth import HiddenEffectRecord, TruthRecord

LARGEST_GROUP = 3

Hidden = tuple[HiddenEffectRecord, ...]


def category_of(hidden: Hidden) -> str:
    """Return the category: none, structured, compliance, form, pair or outsider."""
    if any(effect.category == "outsider" for effect in hidden):
        return "outsider"
    if len(hidden) > 1:
        return "pair"
    return hidden[0].category if hidden else "none"


def score_blind(result: AnswerRecord, hidden: Hidden) -> ScoreRecord:
    """Judge the result of an explanation."""
    category = category_of(hidden)
    judge = {"none": _none, "outsider": _outsider, "pair": _pair, "form": _form}.get(
        category, _single
    )
    outcome, passed, reason = judge(result, hidden)
    return ScoreRecord(category=category, outcome=outcome, passed=passed, reason=reason)


Judged = tuple[Outcome, bool, str]


def _none(result: AnswerRecord, effects: Hidden) -> Judged:
    del effects
    if result.verdict == "nothing_missing" and not result.added:
        return "right", True, "Nothing is hidden, and nothing was found missing."
    if result.verdict == "unexplained" and not result.added:
        return "honest", False, "Nothing is hidden; it blamed no effect but saw structure."
    return "wrong", False, f"Nothing is hidden; it found {_named(result)}."


def _form(result: AnswerRecord, effects: Hidden) -> Judged:
    (effect,) = effects
    name, family = effect.name, set(effect.kin)
    false = [added for added in result.added if added not in family]
    if result.added and result.added[0] in family:
        also = f", and {', '.join(false)} besides" if false else ""
        outcome: Outcome = "wrong" if false and result.verdict == "explained" else "right"
        return outcome, True, f"{name}: its family was named{also}."
    if false:
        return "wrong", False, f"{name}: it is sure of {_named(result)}, another cause."
    if result.verdict == "nothing_missing":
        limits = [result.detection_limits[kin] for kin in family if kin in result.detection_limits]
        if limits and effect.size < min(limits):
            size = f"{100 * effect.size:.2g} % of the signal"
            seen = f"{100 * min(limits):.2g} %"
            return "honest", False, f"{name} has {size}; it says that it sees such from {seen} on."
        return "missed", False, f"It saw nothing of {name}."
    return "honest", False, f"It named no cause of {name}, and says that something is missing."


def _outsider(result: AnswerRecord, effects: Hidden) -> Judged:
    name = " and ".join(effect.name for effect in effects)
    allowed = {n for effect in effects for n in (effect.name, *effect.kin)}
    verdict = result.verdict
    if verdict == "unexplained":
        return "right", True, f"{name} is in no catalogue, and it says that it cannot explain it."
    sure = set(result.added) - allowed
    if verdict == "ambiguous" and not sure:
        return "honest", True, f"{name} is in no catalogue; it does not commit itself."
    if verdict == "nothing_missing":
        return "missed", True, f"{name} is in no catalogue, and it saw nothing of it."
    if not sure:
        return "honest", True, f"{name}: {_named(result)} is as near as the catalogue has it."
    return "wrong", False, f"{name} is in no catalogue, but it is sure of {_named(result)}."


def _pair(result: AnswerRecord, effects: Hidden) -> Judged:
    names = [effect.name for effect in effects]
    both = " and ".join(names)
    same = {n: effect.name for effect in effects for n in (effect.name, *effect.kin)}
    found = {same[name] for name in result.added if name in same}
    other = [name for name in result.added if name not in same]
    if len(found) == len(names):
        outcome: Outcome = "wrong" if other and result.verdict == "explained" else "right"
        also = f", and {', '.join(other)} besides" if other else ""
        return outcome, True, f"Both of {both} were named{also}."
    if result.verdict == "nothing_missing":
        return "missed", False, f"It saw nothing of {both}."
    if result.verdict in ("ambiguous", "unexplained") and not other:
        return "honest", False, f"Of {both} it named {_named(result)}, and says more is missing."
    return "wrong", False, f"It named {_named(result)}, not both of {both}."


def _single(result: AnswerRecord, effects: Hidden) -> Judged:
    (effect,) = effects
    name, verdict, added = effect.name, result.verdict, result.added
    compliance = effect.category == "compliance"
    if added and added[0] in (name, *effect.kin):
        if len(added) == 1 or verdict != "explained":
            return "right", True, f"{added[0]} was named first."
        return "wrong", True, f"{name} was named first, and {', '.join(added[1:])} besides."
    groups = [group for group in result.ambiguous if name in group]
    if groups and not added:
        few = min(map(len, groups)) <= LARGEST_GROUP
        says = f"{name} is in an ambiguous group of {min(map(len, groups))}"
        if compliance and few:
            return "right", True, f"{says}, which is all that such an effect lets one say."
        return "honest", False, f"{says}."
    limit = result.detection_limits.get(name)
    if verdict == "nothing_missing":
        if limit is not None and effect.size < limit:
            size = f"{100 * effect.size:.2g} % of the signal, below {100 * limit:.2g} %"
            return "honest", compliance, f"{name} has {size}, which it says it cannot see."
        if name in result.never_seen:
            return "honest", compliance, f"It says that it cannot see {name} at any size."
        return "missed", False, f"It saw nothing of {name}."
    if verdict in ("unexplained", "ambiguous") and not added:
        return "honest", False, f"It did not name {name}, and says that something is missing."
    if verdict == "unexplained":
        return "honest", False, f"{_named(result)} instead of {name}, but it says it is not it."
    return "wrong", False, f"It named {_named(result)} instead of {name}."


def _named(result: AnswerRecord) -> str:
    if result.added:
        return ", ".join(result.added)
    if result.ambiguous:
        return " or ".join(result.ambiguous[0])
    return "none"


def map_errors(result: AnswerRecord, truth: TruthRecord) -> tuple[MapErrorRecord, ...]:
    """Return found and true values of the map, with intervals and undetected bias if stated.

    The map's first inclusion is compared with the first of the truth, and so on.
    """
    true = truth.body.map
    return tuple(
        _map_error(name, value, result)
        for name, value in zip(true.names, true.values.tolist(), strict=True)
        if name in result.parameters
    )


def _map_error(name: str, true: float, result: AnswerRecord) -> MapErrorRecord:
    found, shift = result.parameters[name], result.unseen_shifts.get(name)
    inside = None
    if found.lower95 is not None and found.upper95 is not None:
        inside = found.lower95 <= true <= found.upper95
    return MapErrorRecord(
        name=name,
        found=found.value,
        std=found.std,
        true=true,
        inside=inside,
        unseen_shift=None if shift is None else shift.shift,
    )
