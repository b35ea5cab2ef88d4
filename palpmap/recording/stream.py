"""One .rrd file under construction: places on the timelines, flushes, layout."""

import ctypes
import errno
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from palpmap.recording import entities as parts
from palpmap.recording.integrity import examine

LONGEST_FLUSH_S, LONGEST_LIVE_S = 20.0, 2.0
Log = Callable[..., None]
"""``log(entity, *archetypes)``, bound to a place on the timelines."""


class RecordingFile:
    """A Rerun stream into a file.

    Parameters
    ----------
    path : path of the .rrd file; an existing one is replaced
    name : name of the recording, shown by the viewer
    live : address of a viewer that follows meanwhile. It has a stream of its own, so that the file
        is whole whatever becomes of the viewer.
    """

    def __init__(self, path: Path, name: str, live: str | None = None) -> None:
        self._path = path
        self._stopped: OSError | None = None
        self.curves: dict[str, tuple[float, float]] = {}
        self.stream = rr.RecordingStream(parts.APPLICATION)
        self.stream.save(path)
        self._streams = [self.stream]
        if live is not None:
            same = self.stream.get_recording_id()
            self._streams.append(rr.RecordingStream(parts.APPLICATION, recording_id=same))
            self._streams[1].connect_grpc(live)
        for stream in self._streams:
            rr.set_log_time_enabled(False, recording=stream)
            rr.set_log_tick_enabled(False, recording=stream)
            stream.send_recording_name(name)

    def static(self, entity: str, *components: rr.AsComponents) -> None:
        """Log for all times."""
        for stream in self._streams:
            stream.log(entity, *components, static=True)

    def at(
        self,
        sim_time: float | None = None,
        press: int | None = None,
        iteration: int | None = None,
    ) -> Log:
        """Bind a place: s on `sim_time`, numbers on the others; None leaves a timeline out."""

        def log(entity: str, *components: rr.AsComponents) -> None:
            for stream in self._streams:
                stream.reset_time()
                if sim_time is not None:
                    stream.set_time(parts.SIM_TIME, duration=float(sim_time))
                if press is not None:
                    stream.set_time(parts.PRESS, sequence=int(press))
                if iteration is not None:
                    stream.set_time(parts.ITERATION, sequence=int(iteration))
                stream.log(entity, *components)
            for component in components:
                if isinstance(component, rr.Scalars) and component.scalars is not None:
                    self.count(entity, component.scalars.as_arrow_array().to_numpy())

        return log

    def count(self, entity: str, values: np.ndarray) -> None:
        """Keep least and largest value of a curve, `curves`, for the room beside its legend."""
        low, high = self.curves.get(entity, (np.inf, -np.inf))
        self.curves[entity] = min(low, float(values.min())), max(high, float(values.max()))

    def show(self, blueprint: rrb.Blueprint) -> None:
        """Embed a layout; the viewer opens with the last one embedded."""
        for stream in self._streams:
            stream.send_blueprint(blueprint)

    def flush(self) -> None:
        """Hand all that was logged to the operating system.

        Raises
        ------
        OSError
            The disk is full, so that the writer has stopped; it does not always say so.
        """
        if self._stopped is not None:
            raise self._stopped
        try:
            self.stream.flush(timeout_sec=LONGEST_FLUSH_S)
        except (RuntimeError, ValueError) as error:
            _keep_for_ever(self.stream)
            reason = f"no answer from the disk: {str(error).splitlines()[0]}"
            self._stopped = OSError(errno.EIO, reason, str(self._path))
            raise self._stopped from error
        for stream in self._streams[1:]:
            try:
                stream.flush(timeout_sec=LONGEST_LIVE_S)
            except (RuntimeError, ValueError):  # the viewer was closed
                self._drop(stream)

    def _drop(self, stream: rr.RecordingStream) -> None:
        self._streams.remove(stream)
        with suppress(RuntimeError, ValueError):
            stream.disconnect()

    def close(self) -> None:
        """Write the footer, which marks a whole recording.

        Raises
        ------
        OSError
            The file has no footer: the disk is full. It is readable as far as it goes.
        """
        self.flush()
        for stream in self._streams[:0:-1]:
            self._drop(stream)
        self.stream.disconnect()
        if not examine(self._path).closed:
            reason = "the recording could not be written whole; make room on the disk"
            raise OSError(errno.ENOSPC, reason, str(self._path))


def _keep_for_ever(stream: rr.RecordingStream) -> None:
    """Let a stream whose writer has stopped outlive the process: its end waits for the writer."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))
    rr.unregister_shutdown()
