"""What an explanation says in words: the verdict, what it rests on, and what it does not know.

No sentence here is more certain than result.json.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from identify.body.discretization_error import MODEL_ERROR
from identify.design.detection_limits import SHARE
from identify.effects import units
from identify.effects.units import percent
from identify.residual.statement import length
from identify.select.forward_selection import Explanation
from identify.select.settings import SELECTION
from palpmap.result.evidence import added_names, kept
from palpmap.study.open_study import Problem

_NAMED = 3  # of the effects that may have moved the parameters unseen

VERDICTS = {  # but see `headline`
    "nothing_missing": ("Nothing is seen to be missing.", "green"),
    "explained": ("Explained.", "green"),
    "ambiguous": ("Ambiguous: this scan cannot tell these effects apart.", "yellow"),
    "unexplained": ("Unexplained: no known effect removes the structure of the residual.", "red"),
}

CANDIDATES = {
    "supported": "supported",
    "indistinguishable": "cannot be told apart",
    "not_seen": "not seen",
    "untestable": "cannot be tested",
    "helps": "helps, but structure remains",
}


def headline(explained: Explanation) -> str:
    """Return the verdict as a sentence."""
    if explained.verdict == "unexplained" and explained.final.comparison.is_noise:
        if explained.at_bound or explained.implausible:
            return "Unexplained: the only model that fits has implausible parameter values."
        return "Unexplained: more is seen to be missing than could be found."
    return VERDICTS[explained.verdict][0]


def verdict_detail(explained: Explanation) -> str:
    """Return the verdict's own sentence: which effects, or what is left."""
    sure = listed(explained.added)
    if explained.verdict == "nothing_missing":
        if explained.traces:
            return (
                f"The residual is noise, with a trace of {' or '.join(explained.traces)} that is "
                "not significant, not justified by the information criterion, or within the "
                "model error."
            )
        return "The residual is noise, and no effect of the catalogue is seen in it."
    if explained.verdict == "explained":
        return f"With {sure} in the model, the residual is noise."
    if explained.verdict == "ambiguous":
        text = "; ".join(" or ".join(group) for group in explained.ambiguous) + "."
        return text + (f" Beside it: {sure}." if sure else "")
    return f"{_help(explained)}{explained.final.comparison.statement}"


def rung_labels(explained: Explanation) -> list[str]:
    """Return what each rung of the ladder changed: "map alone", "+ viscoelasticity"."""
    labels, had = [], ()
    for number, rung in enumerate(explained.ladder):
        has = rung.fit.effect_names
        new = [f"+ {name}" for name in has if name not in had]
        lost = [f"− {name}" for name in had if name not in has]
        start = ["map alone" if not has else "map"] if number == 0 else []
        labels.append("\n".join([*start, *new, *lost]))
        had = has
    return labels


def listed(names: Sequence[str]) -> str:
    """Return names as a list in a sentence.

    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    return " and ".join([", ".join(names[:-1])] * (len(names) > 1) + list(names[-1:]))


def _help(explained: Explanation) -> str:
    """Say how much the additions of an unexplained scan take, and that they are not the answer."""
    helpers = [a.name for a in explained.accepted]
    if not helpers:
        return _nearest(explained)
    one = len(helpers) == 1
    if explained.map_error and explained.added:
        return (
            f"The presses call for {listed(explained.added)}, whatever the map. In displacement, "
            "most of the residual is in the map. "
        )
    if bound := [name for name in helpers if name in explained.at_bound]:
        return (
            f"With {listed(helpers)} the error falls, but only with more of {listed(bound)} than "
            "can be: at the bound of what is possible it is a help, not the answer. "
        )
    if implausible := [name for name in helpers if name in explained.implausible]:
        return (
            f"With {listed(helpers)} the error falls, but {listed(implausible)} only at "
            "implausible values: a help, not the answer. "
        )
    text = f"{listed(helpers)} {'takes' if one else 'take'} "
    text += f"{percent(explained.explained_share)} of the unexplained error"
    if not explained.added:
        return f"{text}, but leave{'s' if one else ''} structure: a help, not the answer. "
    return f"{text}; the rest has another cause. "


def _nearest(explained: Explanation) -> str:
    """Say how little the best-scored effect would take, where that is why none was added."""
    diagnosis = explained.final.diagnosis
    found = [score for score in diagnosis.scores if score.name in diagnosis.significant]
    if not found:
        return ""
    name = max(found, key=lambda score: score.statistic).name
    share = diagnosis.explained_fraction(name)
    if share >= SELECTION.worthwhile or explained.map_error:
        return ""  # a refit did not bear it out, or nothing of the body may be offered
    share = percent(share)
    return f"The nearest of the catalogue, {name}, would take {share} of the unexplained error. "


def step_evidence(explained: Explanation, problem: Problem, number: int) -> str:
    """Return the sentences of evidence of what was added at rung `number`.

    With the values of the last model that has the effect. Where an effect is not offered as
    found, the sentence is only what it would mean.
    """
    rungs, says = explained.ladder, []
    for name in added_names(rungs[number - 1], rungs[number]):
        having = [rung for rung in rungs[number:] if name in rung.fit.effect_names]
        values = having[-1].fit.at.values[name]
        text = problem.catalogue[name].evidence(values, problem.model.readings)
        says.append(text if name in explained.added else f"If it were {name}: {text}")
    return " ".join(says)


def step_notes(explained: Explanation, number: int) -> list[str]:
    """Return what must be said beside the evidence of the addition that led to rung `number`."""
    before, after = explained.ladder[number - 1], explained.ladder[number]
    text = (
        f"Chi-square goes from {before.fit.chi2:.0f} to {after.fit.chi2:.0f} "
        f"({after.fit.dof} degrees of freedom); in cross-validation, the error "
        f"goes from {length(before.cross_validation.rms_m, signed=False)} to "
        f"{length(after.cross_validation.rms_m, signed=False)}."
    )
    names = added_names(before, after)
    return [text, *(note for name in names for note in _name_notes(explained, name))]


def _name_notes(explained: Explanation, name: str) -> list[str]:
    addition = kept(explained, name)
    if addition is None:
        return [f"{name} lost its place later: beside what was added after it, it is not needed."]
    if len(addition.group) > len(addition.equivalents):
        return [
            f"{listed(addition.group)} cannot be told apart: beyond what the map takes up, a "
            "slight error of the model, or another form of the map, looks the same as "
            f"{listed([n for n in addition.group if n != MODEL_ERROR])}. Do not take a name, or "
            f"its numbers, for found: {_way_out(explained)}."
        ]
    if len(addition.group) > 1:
        others = " or ".join(other for other in addition.group if other != name)
        return [
            f"{name} stands for a group: with {others} in its place the model is as good. Do not "
            "take its name, or its numbers, for found."
        ]
    if addition.shown_by_presses and name in explained.added and explained.verdict == "unexplained":
        return [f"The presses by themselves call for {name}, whatever the map."]
    if name in explained.resting_on_outliers:
        return [
            f"{name} is only found, or only told from the other candidates, with presses that "
            "stand out by themselves, so it is not offered as the missing effect."
        ]
    if name in explained.at_bound:
        return [
            f"{name} is at the bound of what is possible, so it is not offered as the missing "
            "effect."
        ]
    if name in explained.implausible:
        values = explained.final.fit.at.values[name]
        model = explained.final.fit.model
        (part,) = (part for part in model.effects if part.effect.name == name)
        why = part.effect.doubt(values, model.readings)
        return [f"{name} is not offered as the missing effect: {why}."]
    if name not in explained.added:
        return [
            f"{name} lowers chi-square but leaves structure, so it is not offered as the missing "
            "effect."
        ]
    return []


def _way_out(explained: Explanation) -> str:
    """Say how to tell an effect from an error of the model."""
    radii = explained.final.fit.model.readings.radius_m
    one = radii.max() <= 1.01 * radii.min()
    return ("scan with tips of two radii, or " if one else "") + "rule it out by itself"


def doubts(record: Mapping[str, Any], explained: Explanation) -> list[str]:
    """Return what speaks against taking the verdict at its word."""
    notes = list(explained.final.comparison.notes)
    held = [name for name, p in record["parameters"].items() if p["at_bound"]]
    if held:
        notes.append(
            f"At a bound of what is allowed, so not found: {', '.join(held)}. Nothing that rests "
            "on it is sure."
        )
    if unseen := unseen_inclusions(record):
        notes.append(unseen)
    notes.extend(stated_lengths(record))
    if not explained.final.fit.success:
        notes.append("The last fit did not reach its minimum within its evaluations.")
    if explained.dropped:
        notes.append(f"Added on the way and dropped again: {', '.join(explained.dropped)}.")
    if explained.traces and explained.accepted:
        notes.append(
            f"A trace of {' or '.join(explained.traces)} is left. It is small against what was "
            "explained, and as likely an inaccuracy of the effects that were found."
        )
    left, presses = record["suspects_left"], ", ".join(map(str, record["suspect_presses"]))
    if left:
        notes.append(
            f"Presses that stand out by themselves: {', '.join(map(str, left))}. Look at them "
            "before physics is blamed: a slip, or a wrong place, looks like an effect. "
            + without_suspects(record)
        )
    elif presses:
        notes.append(
            f"Presses {presses} are outliers for the map alone, but not for the last model. "
            + without_suspects(record)
        )
    return notes


def unseen_inclusions(record: Mapping[str, Any]) -> str:
    """Say which inclusions of the map the readings do not ask for, in a sentence; or nothing."""
    unseen = record["unseen_inclusions"]
    if not unseen:
        return ""
    numbers = listed([str(number) for number in unseen])
    mapped = [name for name in record["parameters"] if name.startswith("inclusion_")]
    count = sum(name.endswith(".radius_m") for name in mapped)
    if len(unseen) == 1:
        which = f"Inclusion {numbers} is not seen: without it the model does as well."
    else:
        which = f"Inclusions {numbers} are not all seen: without any one the model does as well."
    return f"{which} Say inclusions = {count - 1} under [map], or scan closer."


def unseen_effects(record: Mapping[str, Any]) -> str:
    """Say what moves the parameters beyond their intervals and is not seen; or nothing."""
    shifts = record.get("unseen_shifts", {})
    if not shifts:
        return ""
    errors = {name: record["parameters"][name]["std"] for name in shifts}
    known = [name for name in shifts if errors[name] > 0]
    known.sort(key=lambda name: shifts[name]["shift"] / errors[name], reverse=True)
    effects = list(dict.fromkeys(shifts[name]["effect"] for name in known))[:_NAMED]
    return (
        "No interval counts what is too small to be seen. 'Unseen effect' says how far an effect "
        f"of at most {percent(SHARE)} of the signal that this scan would not show may have moved a "
        f"parameter (most: {listed(effects)}); `palpmap limits` names the scan that narrows it."
        + _not_counted(record)
    )


def _not_counted(record: Mapping[str, Any]) -> str:
    """Name the effects of which the scan cannot even say how far they may have moved the map."""
    names = record.get("not_counted", ())
    return f" Not counted, as this scan shows nothing of them: {listed(names)}." if names else ""


_LENGTHS = {"tip_radius": "the tip's radius", "body_height": "the body's height"}


def stated_lengths(record: Mapping[str, Any]) -> list[str]:
    """Say which lengths of the study would look like what was found, a sentence for each effect."""
    by_effect: dict[str, list[str]] = {}
    for found in record["stated_lengths"]:
        change = units.length(abs(found["change_m"]))
        side = units.more(found["change_m"], "larger", "smaller")
        by_effect.setdefault(found["effect"], []).append(
            f"{_LENGTHS[found['length']]} were {change} {side} than stated"
        )
    return [
        f"Nearly the same as {effect} would be seen if {', or '.join(what)}. Measure that first."
        for effect, what in by_effect.items()
    ]


def without_suspects(record: Mapping[str, Any]) -> str:
    """Return what the loop finds without the presses that stand out, in a sentence."""
    other = record["without_suspects"]
    if other is None:
        return ""
    if other["verdict"] == "nothing_missing":
        return "Without them nothing is seen to be missing."
    names = [*other["added"], *(" or ".join(group) for group in other["ambiguous"])]
    alike = other["verdict"] == record["verdict"]
    if other["verdict"] == "unexplained":
        return f"Without them{', too,' if alike else ''} something is left unexplained."
    same = alike and names == [
        *record["added"],
        *(" or ".join(group) for group in record["ambiguous"]),
    ]
    return f"Without them the answer is {'the same' if same else listed(names)}."


def limits_of_method(explained: Explanation, record: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what the reader must know of how far this can be trusted."""
    limits = [
        "Standard errors count the noise, under the model of the last step. The errors and "
        "intervals of a map fitted WITHOUT an effect that is there do not cover the truth: they "
        "are as narrow as before, around a wrong value. This is why what is missing has to be "
        "found before a map is believed.",
        "Only effects of the catalogue can be found. What is outside it ends, at best, as "
        "'unexplained'; at worst it looks like a mixture of effects that are inside.",
        "What the stiffness map can imitate cannot be seen: a constant error of the force's "
        "gain, for one, is exactly a softer body.",
        "The errors at presses and at forces left out are linearised around the fit with all "
        "readings; they are not refitted one by one.",
        "The shares and p-values of effects that were not added come from one linear step, with "
        "everything fitted projected out. Shortlisted effects were refitted; they decide.",
    ]
    if explained.final.fit.model.noise.estimated:
        limits.append(
            "The noise was estimated from this very scan: chi-square cannot say by itself whether "
            "the model is right."
        )
    if not record.get("limits"):
        limits.append(
            "How small an effect this scan can show is not in this report; `palpmap limits` says."
        )
    return tuple(limits)


def readable(unit: str) -> tuple[float, str]:
    """Return the factor to a unit for reading, and that unit as it follows a number."""
    return {"Pa": (1e-3, " kPa"), "m": (1e3, " mm"), "1": (1.0, "")}.get(unit, (1.0, f" {unit}"))


def interval(parameter: Mapping[str, Any]) -> str:
    """Return a parameter's 95 % interval in words, or that it was held."""
    if not parameter["std"]:
        return "held"
    scale, unit = readable(parameter["unit"])
    return f"{scale * parameter['lower95']:.4g} to {scale * parameter['upper95']:.4g}{unit}"


def unseen_shift(name: str, record: Mapping[str, Any], named: bool = False) -> str:
    """Return how far an unseen effect may have moved a parameter, in words; or nothing.

    `named` says which effect, too.
    """
    found = record.get("unseen_shifts", {}).get(name)
    if found is None:
        return ""
    scale, unit = readable(record["parameters"][name]["unit"])
    return f"± {scale * found['shift']:.2g}{unit}" + (f" ({found['effect']})" if named else "")


def steps_of(explained: Explanation) -> Sequence[int]:
    """Return the numbers of the rungs that an addition led to."""
    return range(1, len(explained.ladder))
