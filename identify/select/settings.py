"""Tuning numbers of the forward selection, in one record."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SelectionSettings:
    """Thresholds of `identify.select.forward_selection`; all but `most_effects` are shares of 1.

    Attributes
    ----------
    most_effects : largest number of effects added after the first step
    trace : of the chi-square explained: left by laws that are right to a seventh
    imitated : visible share of an effect's pattern below which the map imitates all of it
    worthwhile : least share of the unexplained chi-square for a further effect. In 58 blind trials
        the hidden effect took a third or more, and an imitation of an unknown effect 16 % or less
        from its second step on.
    left_of_error : of the chi-square explained by the possible model error: the pattern of that
        error is an estimate, right to a third, and its own error is in turn like another effect
    by_compliance : of a pattern's square: beyond it, an effect acts on compliances alone
    """

    most_effects: int = 4
    trace: float = 0.02
    imitated: float = 0.05
    worthwhile: float = 0.1
    left_of_error: float = 0.1
    by_compliance: float = 0.9


SELECTION = SelectionSettings()
