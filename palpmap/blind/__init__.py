"""Blind trials: hide an effect, seal the answer, judge what was found."""
