"""The misfit of a step in sentences: few presses that hold it, other maps, an error that rises."""

from collections.abc import Sequence

import numpy as np

from identify.effects import percent
from identify.select import SELECTION, Explanation, PressesApart, Step
from palpmap import units
from palpmap.result.evidence import added_names
from palpmap.result.records import OtherMapRecord

_HARD = 0.7  # of the middle compliance
_AS_NOISE = 1.05  # times the noise: as large as it, to two digits
_LISTED = 6  # presses
_MOST_KEPT = 0.5  # of a misfit: what no map takes


def presses_apart_words(apart: PressesApart) -> str:
    """Say how far presses stand apart from the map of all others.

    >>> presses_apart_words(PressesApart((8, 15), (0.081, 0.093), None, "nothing_missing"))
    'Press 8 yields 8.1 % more, and press 15 9.3 % more, than the map of the others has it: they \
slipped, or met a wrong place or a cause of their own. All else is found without them.'
    """
    each = [
        f"press {press} {'yields ' * (number == 0)}{percent(abs(softer))} "
        f"{'more' if softer > 0 else 'less'}"
        for number, (press, softer) in enumerate(zip(apart.presses, apart.softer, strict=True))
    ]
    they, them, own = ("they", "them", "their") if len(each) > 1 else ("it", "it", "its")
    says = f"{', '.join(each[:-1])}, and {each[-1]}," if len(each) > 1 else each[0]
    return (
        f"{says[0].upper()}{says[1:]} than the map of the others has it: {they} slipped, or met a "
        f"wrong place or a cause of {own} own. All else is found without {them}."
    )


def few_presses_words(explained: Explanation) -> str:
    """Say that few presses hold the structure, where they are, and how well the others are met."""
    final = explained.final
    few, fit = np.array(explained.in_few_presses), final.fit
    squares = np.bincount(fit.press_index, fit.at.residual**2)
    count = np.bincount(fit.press_index)
    share = np.sum((squares - count)[few]) / (fit.chi2 - fit.dof)
    others = np.setdiff1d(np.arange(len(count)), few)
    times = np.sqrt(squares[others].sum() / count[others].sum())
    softness = fit.at.compliance / np.median(fit.at.compliance)
    where = (
        f", where the body is {1 / np.median(softness[few]):.1f} times as hard as at the others"
        if np.median(softness[few]) < _HARD
        else ""
    )
    ids = [final.comparison.presses[j].press for j in few[np.argsort(-squares[few])]]
    said = ", ".join(map(str, ids[:_LISTED]))
    more = f" and {len(ids) - _LISTED} more" if len(ids) > _LISTED else ""
    names = listed([effect.name for effect in explained.accepted])
    return (
        f"These presses hold {percent(min(share, 1.0))} of it{where} ({said}{more}). With {names}, "
        f"the residual of all others is {beyond_noise(times)}.{_with_any_map(explained, few)}"
    )


def beyond_noise(times: float) -> str:
    """Return how large a residual is, by its ratio to the noise.

    >>> beyond_noise(1.03), beyond_noise(1.26)
    ('no larger than the noise', '1.3 times the noise')
    """
    return "no larger than the noise" if times < _AS_NOISE else f"{times:.2g} times the noise"


def _with_any_map(explained: Explanation, few: np.ndarray) -> str:
    """Say how much of their misfit some presses keep, each on a body of its own."""
    fit, law = explained.final.fit, next((a.law for a in explained.accepted if a.law), None)
    if law is None:
        return ""
    squares, count = law.by_press
    by_map = np.bincount(fit.press_index, fit.at.residual**2)
    whole = np.sum((by_map - count)[few])
    kept = np.sum((squares - count)[few]) / whole
    if kept < _MOST_KEPT:
        return ""
    names = listed([effect.name for effect in explained.accepted])
    least = squares if law.on_any_body is None else law.on_any_body
    bent = np.sum((least - count)[few]) / whole
    if bent < _MOST_KEPT:
        return (
            f" A stiffness of its own for each of these presses leaves {percent(min(kept, 1.0))} "
            f"of their misfit beside {names}, but one that changes within the reach of the growing "
            f"contact leaves {percent(max(bent, 0.0))}: the body may be hard or soft close below "
            "the surface there, more sharply than this map has it."
        )
    own = "a stiffness" if bent == kept else "a stiffness and a growth of the contact"
    return (
        f" If each of these presses has {own} of its own, {percent(min(bent, 1.0))} of their "
        f"misfit remains beside {names}: no map takes it, of whatever form. Their contact, or "
        "their readings, are of another kind than the others'."
    )


def rise_note(before: Step, after: Step) -> list[str]:
    """Say why a better fit has a larger error in length, where it has."""
    one, other = before.fit, after.fit
    if other.rms_m <= one.rms_m * SELECTION.error_rise or other.chi2 >= one.chi2:
        return []
    names = listed(added_names(before, after))
    noise = [step.comparison.expected_rms_m for step in (before, after)]
    errors = [np.sqrt(fit.chi2_per_dof) for fit in (one, other)]
    text = (
        f"The error in length rises from {units.rms(one.rms_m)} to {units.rms(other.rms_m)}, and "
        f"yet the model is nearer to the readings: with {names} the error of a reading falls from "
        f"{errors[0]:.3g} to {errors[1]:.3g} times its noise (the root of Chi2/dof). "
    )
    if noise[1] > noise[0]:
        return [
            f"{text}The body yields more to each newton then, so that the same noise of the force "
            f"is a larger length: {units.rms(noise[1])} after {units.rms(noise[0])}."
        ]
    return [f"{text}The readings that the noise hides most have the larger error in length."]


def listed(names: Sequence[str]) -> str:
    """Return names as a list in a sentence.

    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    return " and ".join([", ".join(names[:-1])] * (len(names) > 1) + list(names[-1:]))


def little_left_words(explained: Explanation) -> str:
    """Say how little structure is left, and what that means for the values."""
    fit = explained.final.fit
    excess = (fit.chi2 - fit.dof) / (explained.ladder[0].fit.chi2 - fit.dof)
    left = f"{np.sqrt(fit.chi2_per_dof):.3g} times the noise: {percent(excess)} of the misfit is"
    if excess <= 0:
        left = "as large as the noise: none of the misfit but its pattern is"
    return (
        f" The residual is {left} left, less than laws of contact are right to. Another law could "
        "leave none, with other values."
    )


def only_mends_words(explained: Explanation) -> str:
    """Say that the last effect only mends the fit of the others."""
    if not explained.mended:
        return ""
    chi2 = [step.fit.chi2 for step in explained.ladder]
    share = percent((chi2[-2] - chi2[-1]) / (chi2[0] - chi2[-1]))
    last = listed(added_names(*explained.ladder[-2:]))
    return (
        f" Without {last}, structure is left. It takes {share} of what all explain, and may only "
        "mend the fit of the others."
    )


def other_map_sentence(other: OtherMapRecord | None) -> str:
    """Say whether a map of another form would leave noise.

    >>> other_map_sentence(OtherMapRecord(answer="no_map", chi2_per_dof=9.5, left=0.92,
    ...     map_error=0.0, more_evidence=None, effects=("viscoelasticity",)))
    'No map does either, of whatever form: beside viscoelasticity, 92 % of the misfit remains if \
each press is on a body of its own. The missing cause is no stiffness.'
    """
    if other is None:
        return ""
    beside = f"beside {listed(other.effects)}, " if other.effects else ""
    if other.answer == "no_map" and other.more_evidence is None:
        return (
            f"No map does either, of whatever form: {beside}{percent(other.left)} of the misfit "
            "remains if each press is on a body of its own. The missing cause is no stiffness."
        )
    if other.answer == "no_map":
        return (
            f"A map of another form does not either: {beside}{percent(other.left)} of the misfit "
            "remains with a free map. The missing cause is more than stiffness."
        )
    if other.answer == "undecided":
        found = "the search for a free map did not end"
        if other.more_evidence is not None:  # under a ball
            left = f"leaves {percent(other.left)} of the misfit"
            found = f"{beside}a free map, which is smooth below a contact, {left}"
        return (
            "Whether a map of another form would do is not decided: the single presses do not "
            f"exclude it, but {found}."
        )
    more = f"chi-square per degree of freedom {other.chi2_per_dof:.3g}"
    if other.more_evidence is not None:
        side = "above" if other.more_evidence > 0 else "below"
        more += f", log evidence {abs(other.more_evidence):.3g} {side} that of the inclusions"
    if other.answer == "another_map":
        alone = "" if other.effects else ", and it needs no effect beside it"
        return (
            f"A map of another form would do: {beside}a free map leaves noise ({more}){alone}. "
            "Causes that act on compliances alone (support, tool, shape of the body) may hide in "
            "such a map. The numbers below are those of the map that does not do."
        )
    if other.answer == "either":
        return (
            f"A map of another form could take it, but the scan speaks against it: {beside}a free "
            f"map leaves noise too ({more}). Map or physics is not decided here."
        )
    return (
        f"No smooth map does: {beside}a free map leaves noise only with an error of "
        f"{percent(other.map_error)} in each press ({more}). Places, tips or contacts may differ "
        "from press to press."
    )
