"""Judging an explanation against what was hidden: right, honest, missed or wrong.

| hidden | passes if |
|---|---|
| nothing | the verdict is `nothing_missing` |
| a structured effect | it is named first |
| a compliance-like effect | it is named first, or in an ambiguous group of at most three, or is \
smaller than the detection limit that was printed |
| two effects | both are named |
| an outsider | the verdict is not `explained` |
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

LARGEST_GROUP = 3

Outcome = Literal["right", "honest", "missed", "wrong"]


@dataclass(frozen=True)
class BlindScore:
    """How good an answer is.

    Attributes
    ----------
    category : none, structured, compliance, pair or outsider
    outcome : `right`; `honest` where it does not know and says so; `missed` where it sees nothing;
        `wrong` where it is sure of what is not so
    passed : by the table of this module
    reason : one sentence
    """

    category: str
    outcome: Outcome
    passed: bool
    reason: str


def category_of(answer: Mapping[str, Any]) -> str:
    """Return the category of what is hidden: none, structured, compliance, pair or outsider."""
    effects = answer["effects"]
    if any(effect["category"] == "outsider" for effect in effects):
        return "outsider"
    if len(effects) > 1:
        return "pair"
    return effects[0]["category"] if effects else "none"


def score_blind(result: Mapping[str, Any], answer: Mapping[str, Any]) -> BlindScore:
    """Judge the result of an explanation.

    Parameters
    ----------
    result : with `verdict`, `added`, `ambiguous`, and where the loop gives them
        `detection_limits`, share of the signal by effect, and `never_seen`, names
    answer : with `effects`, each with `name`, `category`, `size` and optionally `kin`, names that
        come as near as the catalogue has it
    """
    category = category_of(answer)
    judge = {"none": _none, "outsider": _outsider, "pair": _pair}.get(category, _single)
    outcome, passed, reason = judge(result, answer["effects"])
    return BlindScore(category, outcome, passed, reason)


Judged = tuple[Outcome, bool, str]


def _none(result: Mapping[str, Any], effects: list[dict[str, Any]]) -> Judged:
    del effects
    if result["verdict"] == "nothing_missing" and not result["added"]:
        return "right", True, "Nothing is hidden, and nothing was found missing."
    if result["verdict"] == "unexplained" and not result["added"]:
        return "honest", False, "Nothing is hidden; it blamed no effect but saw structure."
    return "wrong", False, f"Nothing is hidden; it found {_named(result)}."


def _outsider(result: Mapping[str, Any], effects: list[dict[str, Any]]) -> Judged:
    name = " and ".join(effect["name"] for effect in effects)
    allowed = {n for effect in effects for n in (effect["name"], *effect.get("kin", ()))}
    verdict = result["verdict"]
    if verdict == "unexplained":
        return "right", True, f"{name} is in no catalogue, and it says that it cannot explain it."
    sure = set(result["added"]) - allowed
    if verdict == "ambiguous" and not sure:
        return "honest", True, f"{name} is in no catalogue; it does not commit itself."
    if verdict == "nothing_missing":
        return "missed", True, f"{name} is in no catalogue, and it saw nothing of it."
    if not sure:
        return "honest", True, f"{name}: {_named(result)} is as near as the catalogue has it."
    return "wrong", False, f"{name} is in no catalogue, but it is sure of {_named(result)}."


def _pair(result: Mapping[str, Any], effects: list[dict[str, Any]]) -> Judged:
    names = [effect["name"] for effect in effects]
    both = " and ".join(names)
    found = [name for name in names if name in result["added"]]
    other = [name for name in result["added"] if name not in names]
    if len(found) == len(names):
        outcome: Outcome = "wrong" if other and result["verdict"] == "explained" else "right"
        also = f", and {', '.join(other)} besides" if other else ""
        return outcome, True, f"Both of {both} were named{also}."
    if result["verdict"] == "nothing_missing":
        return "missed", False, f"It saw nothing of {both}."
    if result["verdict"] in ("ambiguous", "unexplained") and not other:
        return "honest", False, f"Of {both} it named {_named(result)}, and says more is missing."
    return "wrong", False, f"It named {_named(result)}, not both of {both}."


def _single(result: Mapping[str, Any], effects: list[dict[str, Any]]) -> Judged:
    (effect,) = effects
    name, verdict, added = effect["name"], result["verdict"], result["added"]
    compliance = effect["category"] == "compliance"
    if added and added[0] == name:
        if len(added) == 1 or verdict != "explained":
            return "right", True, f"{name} was named first."
        return "wrong", True, f"{name} was named first, and {', '.join(added[1:])} besides."
    groups = [group for group in result["ambiguous"] if name in group]
    if groups and not added:
        few = min(map(len, groups)) <= LARGEST_GROUP
        says = f"{name} is in an ambiguous group of {min(map(len, groups))}"
        if compliance and few:
            return "right", True, f"{says}, which is all that such an effect lets one say."
        return "honest", False, f"{says}."
    limit = result.get("detection_limits", {}).get(name)
    if verdict == "nothing_missing":
        if limit is not None and effect["size"] < limit:
            size = f"{100 * effect['size']:.2g} % of the signal, below {100 * limit:.2g} %"
            return "honest", compliance, f"{name} has {size}, which it says it cannot see."
        if name in result.get("never_seen", ()):
            return "honest", compliance, f"It says that it cannot see {name} at any size."
        return "missed", False, f"It saw nothing of {name}."
    if verdict in ("unexplained", "ambiguous") and not added:
        return "honest", False, f"It did not name {name}, and says that something is missing."
    if verdict == "unexplained":
        return "honest", False, f"{_named(result)} instead of {name}, but it says it is not it."
    return "wrong", False, f"It named {_named(result)} instead of {name}."


def _named(result: Mapping[str, Any]) -> str:
    if result["added"]:
        return ", ".join(result["added"])
    if result["ambiguous"]:
        return " or ".join(result["ambiguous"][0])
    return "none"


def map_errors(result: Mapping[str, Any], answer: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return found and true values of the map: name, found, std, true, inside (the interval).

    `unseen_shift` is how far the result says that an unseen effect may have moved it. The map's
    first inclusion is compared with the first of the truth, and so on.
    """
    body = answer["body"]
    true = {"background_pa": body["background_pa"]}
    for number, inclusion in enumerate(body["inclusions"], start=1):
        true |= {f"inclusion_{number}.{name}": value for name, value in inclusion.items()}
    rows = []
    for name, value in true.items():
        found = result.get("parameters", {}).get(name)
        if found:
            row = {"name": name, "found": found["value"], "std": found.get("std"), "true": value}
            if "lower95" in found:
                row["inside"] = found["lower95"] <= value <= found["upper95"]
            if shift := result.get("unseen_shifts", {}).get(name):
                row["unseen_shift"] = shift["shift"]
            rows.append(row)
    return rows
