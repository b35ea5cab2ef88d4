"""The page of a recording under construction: text and layout of the parts that it has so far."""

from collections.abc import Iterable, Mapping

import rerun as rr

from palpmap.recording import entities as names
from palpmap.recording.layout import Stage, layout
from palpmap.recording.story import story
from palpmap.recording.stream import RecordingFile


class Page:
    """Text and layout, written anew when they change.

    Parameters
    ----------
    file : the recording
    name : of the run

    Attributes
    ----------
    stage : of the scene, without which there is no layout
    residual_limit_um : end of the scale of the residuals
    figures : names of the figures, each shown in a tab
    """

    def __init__(self, file: RecordingFile, name: str) -> None:
        self.stage: Stage | None = None
        self.residual_limit_um = 0.0
        self.figures: list[str] = []
        self._file, self._name = file, name
        self._present: set[str] = set()
        self._showing: tuple[frozenset[str], float] | None = None
        self._text = ""

    def show(
        self, parts: Iterable[str], found: Mapping[str, float], true: Mapping[str, float]
    ) -> None:
        """Add parts (names of `entities.PARTS`), and the present estimates beside true values."""
        self._present.update(parts)
        text = story(self._name, self._present, found, true)
        if text != self._text:
            self._file.static(names.ABOUT, rr.TextDocument(text, media_type="text/markdown"))
            self._text = text
        showing = (frozenset(self._present), self.residual_limit_um)
        if self.stage is not None and showing != self._showing:
            limit = self.residual_limit_um
            whole = self._file.curves if "comparison" in self._present else {}  # it does not grow
            self._file.show(layout(self._present, self.stage, limit, self.figures, whole))
            self._showing = showing
