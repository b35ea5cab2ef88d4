"""Blind trials: hide an effect, seal the answer, judge the finding."""
