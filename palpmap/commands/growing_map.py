"""The map of a scan that goes on, fitted to the presses so far, as a live viewer shows it."""

from dataclasses import replace

from identify.fit import fit_map
from models import InputError, Scan
from palpmap.experiment import Experiment
from palpmap.recording.recorder import Recording
from palpmap.result.outline import study_outline
from palpmap.run_files.fit_run import record_step
from palpmap.study.study import Study

GROWTH = 2
"""Ratio of the presses of two estimates: all of a scan together cost as much as two of the last."""


class GrowingMap:
    """Estimates of the map in a recording, each from twice as many presses as the one before.

    Parameters
    ----------
    recording : of the scan
    study : facts that are known before the scan
    """

    def __init__(self, recording: Recording, study: Study) -> None:
        self._recording, self._study = recording, study
        self._next, self._known, self._made = 0, 0, 0

    def follow(self, scan: Scan, *, whole: bool = False) -> None:
        """Fit the map to the presses so far, if they are enough more or the whole scan."""
        count = len(scan.press_ids)
        if count < self._next and not (whole and count > self._known):
            return
        try:
            opened = Experiment.of(scan, self._study).opened(thin=False)
            found = fit_map(opened, rough=True)
        except ValueError as error:  # all errors of mesh, solver and search: no scan is lost for it
            self._next = count + 1
            if self._made or not isinstance(error, InputError):  # too few presses at first
                self._recording.event(f"no estimate of the map: {error}", "WARN")
            return
        self._next, self._known = GROWTH * count, count
        last = found.history[-1]
        outline = study_outline(self._study)
        record_step(self._recording, replace(last, iteration=self._made), outline)
        self._recording.event(f"estimate of the map from {count} presses", "INFO")
        self._made += 1
