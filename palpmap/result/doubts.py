"""Doubts about an explanation and its limits, in sentences."""

from collections.abc import Sequence

import numpy as np

from identify.design import DETECTION
from identify.effects import COUNTED_FROM, digits, length, more, percent
from identify.select import Explanation
from palpmap import units
from palpmap.result.misfit_words import listed
from palpmap.result.records import CandidateRecord, ExplainRecord, FormRecord, LimitRecord
from palpmap.study.contact_body import assumed_margin_m
from palpmap.study.open_study import Problem

_NAMED = 3  # effects with the largest unseen shifts
_THIN = 4.5  # tip radii: a thinner body hardens by its geometry, see `finite_strain`
_FORM_COUNTS = 1.2  # times the interval by one form, from which on its growth is told


def doubts(record: ExplainRecord, explained: Explanation) -> list[str]:
    """Return the reservations about the verdict."""
    notes = [
        *explained.final.comparison.notes,
        *bound_notes(record),
        *form_notes(record, explained),
        *counting_notes(explained),
    ]
    if unseen := unseen_inclusions(record):
        notes.append(unseen)
    notes.extend(stated_lengths(record))
    if unended := unended_fit(explained):
        notes.append(unended)
    if explained.dropped:
        notes.append(f"Added on the way and dropped again: {', '.join(explained.dropped)}.")
    if explained.traces and explained.accepted:
        notes.append(
            f"A trace of {' or '.join(explained.traces)} remains. It is small against the "
            "explained part, and may as well be an inaccuracy of the effects that were found."
        )
    return [*notes, *outlier_notes(record)]


def unended_fit(explained: Explanation) -> str | None:
    """Return a sentence on a last fit that did not converge."""
    if explained.final.fit.success:
        return None
    return "The last fit did not converge: its map and its intervals are no result."


def bound_notes(record: ExplainRecord) -> list[str]:
    """Return a sentence on the parameters at a bound, if there are any."""
    held = [name for name, p in record.parameters.items() if p.at_bound]
    return [f"At a bound, so not found: {', '.join(held)}."] if held else []


def form_notes(record: ExplainRecord, explained: Explanation) -> list[str]:
    """Return sentences on how much of the map's intervals rests on the form of an effect."""
    last, *others = record.forms or (None,)
    if last is None or not others:
        return _next_forms(explained)
    beside = listed(
        [f"{form.effect} in place of {form.in_place_of} {percent(form.weight)}" for form in others]
    )
    alone = explained.final.fit.parameters

    def wider(name: str) -> float:
        counted, own = record.parameters[name], alone[name]
        return (counted.upper95 - counted.lower95) / max(own.upper95 - own.lower95, 1e-300)

    free = [name for name in explained.final.fit.map.names if alone[name].free]
    text = (
        f"The form is open: the last model counts {percent(last.weight)}, {beside}. "
        f"{_simplest(others[0], last, explained)}The map's intervals are those of all together."
    )
    if not free or wider(most := max(free, key=wider)) < _FORM_COUNTS:
        return [text]
    own, counted = alone[most], record.parameters[most]
    return [
        f"{text} With this form alone, the {units.plain_name(most)} would be "
        f"{units.interval(own.lower95, own.upper95, own.unit)}; counted it is "
        f"{units.interval(counted.lower95, counted.upper95, counted.unit)}."
    ]


def _simplest(heaviest: FormRecord, last: FormRecord, explained: Explanation) -> str:
    """Say why the last model has the effect that it has where a larger law has more evidence."""
    if heaviest.weight <= last.weight:
        return ""
    accepted = next(a for a in explained.accepted if a.name == heaviest.in_place_of)
    size = {c.name: len(c.fit.u) for c in accepted.candidates}
    further = size[heaviest.effect] - size[accepted.name]
    if further <= 0:
        return ""
    return (
        f"{accepted.name} is named, as it does without {further} parameters of {heaviest.effect} "
        "that the scan does not call for. "
    )


def _next_forms(explained: Explanation) -> list[str]:
    """Return for each accepted effect its nearest other form, in a sentence."""
    says = []
    for accepted in explained.accepted:
        own = next((c for c in accepted.candidates if c.name == accepted.name), None)
        if own is None or accepted.name not in explained.added:
            continue
        forms = [c for c in accepted.candidates if c.family == own.family and c is not own]
        if not forms:
            continue
        near = min(forms, key=lambda c: c.criterion)
        apart, price = near.chi2 - own.chi2, len(near.fit.u) - len(own.fit.u)
        says.append(
            f"Of the forms of this cause {accepted.name} fits best for its number of parameters. "
            f"The next, {near.name}, has a chi-square {digits(abs(apart))} "
            + more(apart, "higher", "lower")
            + (f" with {abs(price)} {more(price, 'more', 'fewer')} parameters." if price else ".")
        )
    return says


def counting_notes(explained: Explanation) -> list[str]:
    """Return a sentence on the start of the travel's count where the study does not state it."""
    fit = explained.final.fit
    if fit.model.readings.travel_from:
        return []
    found: dict[str, list[str]] = {}
    for part in fit.model.effects:
        if part.effect.counted_from and part.effect.name in explained.added:
            found.setdefault(part.effect.counted_from, []).append(part.effect.name)
    if len(found) == 2:
        shown = " and ".join(f"{listed(n)} from {COUNTED_FROM[k]}" for k, n in found.items())
        return [f"Travel cannot count from both: {shown}. State travel_from under [study]."]
    return [
        f"Found from the data: travel counts from {COUNTED_FROM[kind]}, as {listed(names)} shows "
        f'in no other. If that is known, state travel_from = "{kind}" under [study].'
        for kind, names in found.items()
    ]


def outlier_notes(record: ExplainRecord) -> list[str]:
    """Return a sentence on the outlying presses, if there are any.

    Not where they are among those of which the verdict says that they hold the structure.
    """
    told = {*record.few_presses, *record.presses_apart}  # by the verdict
    if record.suspects_left and set(record.suspects_left) <= told:
        return []
    left, first = (
        ", ".join(map(str, ids)) for ids in (record.suspects_left, record.suspect_presses)
    )
    if left:
        says = (
            f"Outlying presses: {left}. Check them before the physics is blamed: a slip, or a "
            "wrong place, looks like an effect."
        )
    elif first:
        one = len(record.suspect_presses) == 1
        which = f"Press {first} is an outlier" if one else f"Presses {first} are outliers"
        says = f"{which} for the map alone, but not for the last model."
    else:
        return []
    return [f"{says} {without_suspects(record)}".strip()]


def unseen_inclusions(record: ExplainRecord) -> str:
    """Return a sentence on the redundant inclusions of the map; empty if there are none."""
    unseen = record.unseen_inclusions
    if not unseen:
        return ""
    numbers = listed([str(number) for number in unseen])
    mapped = [name for name in record.parameters if name.startswith("inclusion_")]
    count = sum(name.endswith(".radius_m") for name in mapped)
    if len(unseen) == 1:
        which = f"Inclusion {numbers} is not seen: without it the model is as good."
    else:
        which = f"Inclusions {numbers} are not seen: without them the model is as good."
    return f"{which} Set inclusions = {count - len(unseen)} under [map], or scan closer."


_LAYERS = (
    "A stiffness that changes with depth alone, as in layers, passes for another background under "
    'one tip: kind = "free" under [map] counts it, a second tip radius shows more of it.'
)


def unseen_effects(record: ExplainRecord, explained: Explanation) -> str:
    """Return sentences on the shifts of the parameters by undetected effects; or empty."""
    shifts, fit = record.unseen_shifts, explained.final.fit
    one_tip = len(np.unique(np.round(fit.model.readings.radius_m, 6))) == 1
    layers = f" {_LAYERS}" if one_tip and fit.field is None else ""
    if not shifts:
        return layers.strip()
    errors = {name: record.parameters[name].std for name in shifts}
    known = [name for name in shifts if errors[name] > 0]
    known.sort(key=lambda name: shifts[name].shift / errors[name], reverse=True)
    effects = list(dict.fromkeys(shifts[name].effect for name in known))[:_NAMED]
    untestable = {one.name for one in record.candidates if one.untestable}
    hidden = [name for name in record.not_counted if name not in untestable]
    counted = " Effects that cannot be tested are not counted." if untestable else ""
    neither = "Nor are" if untestable else "Not counted"
    return (
        "No interval counts undetected effects. 'Unseen effect' is the largest shift of a "
        f"parameter by an undetected effect of at most {percent(DETECTION.bias_share)} of the "
        f"signal, the rms of the modelled displacements (most: {listed(effects)}); "
        "`palpmap limits` names the scan that narrows it."
        + counted
        + (f" {neither}, as this scan shows nothing of them: {listed(hidden)}." if hidden else "")
        + layers
    )


_LENGTHS = {"tip_radius": "the tip's radius", "body_height": "the body's height"}


def stated_lengths(record: ExplainRecord) -> list[str]:
    """Return a sentence for each effect that a wrong length of the study would mimic."""
    by_effect: dict[str, list[str]] = {}
    for found in record.stated_lengths:
        change = length(abs(found.change_m))
        side = more(found.change_m, "larger", "smaller")
        by_effect.setdefault(found.effect, []).append(
            f"{_LENGTHS[found.length]} were {change} {side} than stated"
        )
    return [
        f"The readings would look nearly the same as with {effect} if {', or '.join(parts)}. "
        "Measure that first."
        for effect, parts in by_effect.items()
    ]


def assumptions(explained: Explanation, problem: Problem) -> list[str]:
    """Return sentences on assumed lengths, of which others would look like an effect."""
    return [*_thickness(explained, problem), *_sides(explained, problem)]


def _thickness(explained: Explanation, problem: Problem) -> list[str]:
    """Return a sentence where a body thinner than assumed would harden as its material does."""
    fit = explained.final.fit
    if not problem.study.body.thickness_assumed or "strain_stiffening" not in fit.effect_names:
        return []
    least = length(_THIN * float(fit.model.readings.radius_m.max()))
    return [
        f"The thickness is assumed: a body thinner than {least} hardens by its geometry, which "
        "looks like strain_stiffening. Measure it first."
    ]


def _sides(explained: Explanation, problem: Problem) -> list[str]:
    """Return a sentence where a cause was found, or is missing, beside sides that were assumed."""
    margin_m = assumed_margin_m(problem.study.body)
    if margin_m is None or explained.fitted_verdict == "nothing_missing":
        return []
    return [
        f"The body's sides are not stated; {length(margin_m)} beyond the outermost presses they "
        "are the most likely of those tried. Sides elsewhere would bend the curves of these "
        "presses, which looks like effects of contact and place. Where you know them, state "
        "body.margin_m and explain again."
    ]


def without_suspects(record: ExplainRecord) -> str:
    """Return the result without the outlying presses, in a sentence."""
    other = record.without_suspects
    if other is None:
        return ""
    if other.verdict == "nothing_missing":
        return "Without them no missing effect is detected."
    alike = other.verdict == record.verdict
    if other.verdict == "unexplained":
        return f"Without them{', too,' if alike else ''} the scan is unexplained."
    if other.verdict == "ambiguous" and not record.reliable:
        return "Without them the scan is ambiguous: what it looks like then is not sure either."
    same = alike and (other.added, other.ambiguous) == (record.added, record.ambiguous)
    names = [*other.added, *(" or ".join(group) for group in other.ambiguous)]
    return f"Without them the answer is {'the same' if same else listed(names)}."


def limits_of_method(explained: Explanation, record: ExplainRecord) -> tuple[str, ...]:
    """Return the limits of the method that a reader must know."""
    limits = [
        "Standard errors count the noise, under the model of the last step. The errors and "
        "intervals of a map fitted WITHOUT an effect that is there do not cover the truth: they "
        "are as narrow as before, around a wrong value. The missing effect has to be found before "
        "a map is believed.",
        "Only effects of the catalogue can be found. An effect outside it ends, at best, as "
        "'unexplained'; at worst it looks like a mixture of effects inside.",
        "An effect that the stiffness map can imitate cannot be seen: a constant error of the "
        "force's gain, for one, is exactly a softer body.",
        "The errors of the cross-validation and at forces left out come from one linear step of "
        "the fit with all readings, and from refits where that step would go too far.",
        "The shares and p-values of effects that were not added come from one linear step, with "
        "everything fitted projected out. Shortlisted effects were refitted; the refits decide.",
    ]
    if explained.final.fit.model.noise.estimated:
        limits.append(
            "The noise was estimated from this very scan: chi-square alone cannot tell a right "
            "model from a wrong one."
        )
    if not record.limits:
        limits.append("The detection limits of this scan are not in this report: `palpmap limits`.")
    return tuple(limits)


def untestable_sentences(
    effects: Sequence[CandidateRecord | LimitRecord], start: str = "Cannot be tested"
) -> tuple[str, ...]:
    """Return a sentence for each reason that keeps effects from being tested on a scan."""
    names: dict[str, list[str]] = {}
    for effect in effects:
        if effect.untestable is not None:
            names.setdefault(effect.untestable, []).append(effect.name)
    return tuple(f"{start}, as {why}: {', '.join(n)}." for why, n in names.items())
