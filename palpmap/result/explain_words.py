"""Verdict, evidence, doubts and limits of an explanation in sentences.

No sentence is more certain than result.json.
"""

from collections.abc import Sequence
from dataclasses import replace

from identify.body import MODEL_ERROR
from identify.effects import advice, percent
from identify.residual import law_sentence, sentence
from identify.select import OTHER_CAUSE, SELECTION, Explanation
from palpmap import units
from palpmap.result.evidence import added_names, kept
from palpmap.result.misfit_words import (
    few_presses_words,
    listed,
    little_left_words,
    only_mends_words,
    other_map_sentence,
    presses_apart_words,
    rise_note,
)
from palpmap.result.presses_words import first_readings_sentence
from palpmap.result.records import ExplainRecord, OtherMapRecord
from palpmap.study.frame import evidence
from palpmap.study.open_study import Problem

VERDICTS = {  # but see `headline`
    "nothing_missing": ("No missing effect is detected.", "green"),
    "explained": ("Explained.", "green"),
    "ambiguous": ("Ambiguous: several effects explain this scan equally well.", "yellow"),
    "unexplained": ("Unexplained: no known effect removes the structure of the residual.", "red"),
}

UNRELIABLE = "Not to be relied on: a cause is missing that moves these values."
UNRELIABLE_THERE = (
    "Parameters and map come from the other presses: those that hold the structure count little. "
    "The map under them, and how hard it is there, is not to be relied on."
)

CANDIDATES = {
    "supported": "supported",
    "indistinguishable": "indistinguishable",
    "helps": "partial, structure remains",
    "not_seen": "not seen",
    "untestable": "cannot be tested",
}


def headline(explained: Explanation) -> str:
    """Return the verdict as a sentence."""
    if explained.apart is not None:
        few, others = len(explained.apart.presses), explained.final.fit.model.readings.presses
        return f"Unexplained in {few} of {few + others} presses, which stand apart from all others."
    if explained.verdict == "ambiguous" and explained.within_laws:
        return "Ambiguous: the structure that is left is no larger than the error of contact laws."
    if explained.verdict == "ambiguous" and explained.mended:
        return "Ambiguous: several effects together may imitate one unknown cause."
    if explained.verdict == "ambiguous" and explained.residues:
        small = listed(explained.residues)
        return f"Ambiguous: {small} may only make up for the inexact form of another effect."
    if explained.ambiguous and all(OTHER_CAUSE in group for group in explained.ambiguous):
        return "Ambiguous: the model that fits has values that make its cause doubtful."
    if few := len(explained.in_few_presses) * (explained.verdict == "unexplained"):
        of = explained.final.fit.model.readings.presses
        return f"Unexplained in {few} of {of} presses: no known effect removes their structure."
    return VERDICTS[explained.verdict][0]


def unreliable(record: ExplainRecord) -> str:
    """Say which values of an unexplained scan are not to be relied on."""
    return UNRELIABLE_THERE if record.few_presses else UNRELIABLE


def verdict_detail(explained: Explanation, other: OtherMapRecord | None = None) -> str:
    """Return the sentence that names the effects, or describes the residual.

    `other` maps of an unexplained scan are told last.
    """
    if explained.apart is not None:
        others = explained.others
        said = verdict_detail(others)
        if others.verdict in ("ambiguous", "unexplained"):
            said = f"{headline(others)} {said}"
        return f"{presses_apart_words(explained.apart)} {said}"
    sure = listed(explained.added)
    if explained.verdict == "nothing_missing":
        said = by_chance(explained) or "The residual is noise."
        if explained.traces:
            return (
                f"{said} A trace of {' or '.join(explained.traces)} is not significant, not "
                "justified by the information criterion, or within the model error."
            )
        return f"{said} No effect of the catalogue has left a trace."
    if explained.verdict == "explained":
        chance = by_chance(explained)
        plain = f"With {sure} in the model, the residual is noise."
        said = f"With {sure} in the model: {chance}" if chance else plain
        return said + _of_any_shape(explained)
    if explained.verdict == "ambiguous":
        text = "; ".join(" or ".join(group) for group in explained.ambiguous) + "."
        text += f" In addition: {sure}." if sure else ""
        text += little_left_words(explained) if explained.within_laws else ""
        return text + only_mends_words(explained)
    if explained.in_few_presses:
        return few_presses_words(explained)
    maps = other_map_sentence(other)
    if explained.unknown:
        # A search for another map that did not end says nothing against a course that leaves noise
        open_question = other is not None and other.answer == "undecided"
        told = "" if open_question and explained.told_apart else maps
        return f"{_unknown(explained)} {told}".strip()
    residual = explained.final.comparison
    look = sentence(replace(residual, law=None, course=None))
    if other and other.answer == "another_map":  # what the residual looks like is the wrong map's
        return maps
    return f"{law_sentence(residual)} {look} {_help(explained)}{maps}".strip()


def _of_any_shape(explained: Explanation) -> str:
    """Say of added effects of free shape that a name stands for their shape alone."""
    names = [name for name in explained.added if explained.effect(name).any_shape]
    if not names:
        return ""
    has = "has" if len(names) == 1 else "have"
    such = ", such as a tip that sticks" if names == ["free_loop"] else ""
    return (
        f" {listed(names)} {has} a free shape, which says how the readings go: whatever goes so "
        f"may be the cause{such}."
    )


def by_chance(explained: Explanation) -> str:
    """Say how rarely noise alone leaves the last residual, where that is rare; else nothing."""
    last = explained.final.comparison
    return last.statement if last.is_noise and last.p_value < last.alpha else ""


def step_labels(ladder: Sequence[Sequence[str]]) -> list[str]:
    """Return the change of each step, given the names of its effects.

    >>> step_labels([(), ("skin_layer",), ("viscoelasticity",)])
    ['map alone', '+ skin_layer', '+ viscoelasticity, − skin_layer']
    """
    labels, had = [], ()
    for number, has in enumerate(ladder):
        new = [f"+ {name}" for name in has if name not in had]
        lost = [f"− {name}" for name in had if name not in has]
        start = ["map alone" if not has else "map"] if number == 0 else []
        labels.append(", ".join([*start, *new, *lost]))
        had = has
    return labels


def _help(explained: Explanation) -> str:
    """Return the share of the misfit that the additions of an unexplained scan take."""
    names = [a.name for a in explained.accepted]
    if not names:
        return _nearest(explained)
    called = listed([*explained.added, *(" or ".join(group) for group in explained.ambiguous)])
    if explained.map_error and called:
        return (
            f"The single presses call for {called}, with any map. In displacement, most of the "
            "residual comes from the map. "
        )
    text = f"{listed(names)} {'takes' if len(names) == 1 else 'take'} "
    text += f"{percent(explained.explained_share)} of the unexplained error"
    if explained.added:
        return f"{text}; the rest has another cause. "
    if called:
        return f"{text}. The single presses call for {called}, with any map. "
    return (
        f"{text}: a help, not the answer, as the structure that remains may be the cause of all "
        "that they seem to show. "
    )


def _unknown(explained: Explanation) -> str:
    """Describe the courses that stand in for unknown causes, and the residual beside them."""
    fit = explained.final.fit
    says = [
        part.effect.evidence(fit.at.values[part.effect.name], fit.model.readings)
        for part in fit.model.effects if part.effect.name in explained.unknown
    ]  # fmt: skip
    it = "it" if len(says) == 1 else "them"
    if explained.told_apart:
        all_of_it = listed([it, *explained.added, *explained.parts_of_unknown])
        says.append(f"With {all_of_it} in the model, the residual is noise; the map counts {it}.")
    else:
        share = percent(explained.explained_share)
        says.append(
            f"With {it}, {share} of the misfit goes. {explained.final.comparison.statement}"
        )
    return " ".join(says)


def _nearest(explained: Explanation) -> str:
    """Name the best-scored effect where its share is too small for an addition."""
    diagnosis = explained.final.diagnosis
    found = [score for score in diagnosis.scores if score.name in diagnosis.significant]
    if not found:
        return ""
    name = max(found, key=lambda score: score.statistic).name
    share = diagnosis.explained_fraction(name)
    if share >= SELECTION.worthwhile or explained.map_error:
        return ""  # rejected by its refit, or the body's effects may not be offered
    share = percent(share)
    return f"The nearest of the catalogue, {name}, would take {share} of the unexplained error. "


def step_evidence(explained: Explanation, problem: Problem, number: int) -> str:
    """Return the evidence of the effects that step `number` added.

    The values are those of the last model with the effect. The sentence of an effect that is not
    offered by name is conditional.
    """
    steps, says = explained.ladder, []
    for name in added_names(steps[number - 1], steps[number]):
        having = [step for step in steps[number:] if name in step.fit.effect_names]
        values = having[-1].fit.at.values[name]
        effect, origin_m = explained.effect(name), problem.experiment.origin_m
        text = evidence(effect, values, problem.model.readings, origin_m)
        if "touch" in effect.hooks:
            text = f"{text} {first_readings_sentence(problem.scan)}".strip()
        sure = name in (*explained.added, *explained.unknown)
        says.append(text if sure else f"If it were {name}: {text}")
    return " ".join(says)


def step_notes(explained: Explanation, number: int) -> list[str]:
    """Return chi-square, cross-validation and reservations of step `number`."""
    before, after = explained.ladder[number - 1], explained.ladder[number]
    text = (
        f"Chi-square goes from {before.fit.chi2:.0f} to {after.fit.chi2:.0f} "
        f"({after.fit.dof} degrees of freedom); the error of the cross-validation goes from "
        f"{units.rms(before.cross_validation.rms_m)} to {units.rms(after.cross_validation.rms_m)}."
    )
    names = added_names(before, after)
    rise = rise_note(before, after)
    return [text, *rise, *(note for name in names for note in _name_notes(explained, name))]


def _name_notes(explained: Explanation, name: str) -> list[str]:
    addition = kept(explained, name)
    if addition is None:
        return [f"{name} was dropped later: beside the effects added after it, it is not needed."]
    offered = "so it is not offered as the missing effect."
    if len(addition.group) > len(addition.equivalents):
        others = listed([n for n in addition.group if n != MODEL_ERROR])
        return [
            f"{listed(addition.group)} are indistinguishable here: beyond the share that the map "
            f"takes up, a slight error of the model, or another form of the map, looks like "
            f"{others}. Take neither name nor numbers for found: {_way_out(explained)}."
        ]
    others = " or ".join(other for other in addition.group if other != name)
    if others and addition.decided:
        return [
            f"The cause is decided, its form is not: with {others} in place of {name}, the model "
            "is as good."
        ]
    if others:
        return [
            f"{name} stands for a group: with {others} instead, the model is as good. Take neither "
            "its name nor its numbers for found."
        ]
    structured = explained.fitted_verdict == "unexplained"
    if addition.shown_by_presses and name in explained.added and structured:
        return [f"The single presses call for {name}, with any map."]
    if name in explained.resting_on_outliers:
        return [f"{name} is found, or separated from others, only with outlying presses, {offered}"]
    if name in explained.at_bound:
        return [f"{name} is at the bound of the possible values, {offered}"]
    if name in explained.undetermined:
        return [f"The scan does not determine the size of {name}, {offered}"]
    if name in explained.implausible:
        final = explained.final.fit
        (part,) = (part for part in final.model.effects if part.effect.name == name)
        why = advice(part.effect).doubt(final.at.values[name], final.model.readings)
        return [f"{name} is not offered as the missing effect: {why}."]
    if name in explained.mended:
        return [
            f"{name} may be a part of one unknown cause that several effects imitate, {offered}"
        ]
    if name in explained.beside_edge:
        return [
            f"An inclusion of the map stands at a side of the body, as if it stood for another "
            f"cause beside {name}, {offered}"
        ]
    if name in explained.residues:
        chi2 = [step.fit.chi2 for step in explained.ladder]
        share = percent((chi2[-2] - chi2[-1]) / (chi2[0] - chi2[-1]))
        return [
            f"{name} takes {share} of what all effects explain: it may only make up for the "
            f"inexact form of another effect of the body, {offered}"
        ]
    if name in explained.unknown:
        return ["It stands in for a cause that is in no catalogue: its course is found, no name."]
    if name not in explained.added:
        return [f"{name} lowers chi-square but leaves structure, {offered}"]
    return []


def _way_out(explained: Explanation) -> str:
    """Return the way to separate an effect from an error of the model."""
    radii = explained.final.fit.model.readings.radius_m
    one = radii.max() <= 1.01 * radii.min()
    other = "rule it out by another measurement"
    return f"scan with tips of two radii, or {other}" if one else other


def steps_of(explained: Explanation) -> Sequence[int]:
    """Return the numbers of the steps that an addition led to."""
    return range(1, len(explained.ladder))
