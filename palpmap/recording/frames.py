"""Robot frames of one press: gathered as they come, sent together when the press is done."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from palpmap.recording import entities as parts
from palpmap.recording.scene import vertex_normals, xyzw
from palpmap.recording.stream import Log, RecordingFile

SURFACE_BYTES = 18e6  # of drawn shapes of the surface in a recording, before compression halves it
_MOST_SHAPES = 10  # drawn shapes a press, beyond which the eye sees no difference
_RELEASED = 0.08  # share of the largest force, above its noise, below which the body is released
_STEADY, _OFF = 0.01, 0.05  # shares: change from frame to frame, and from the drawn shape
_STEP = 1e-5  # m, to which shapes are rounded: a body at rest repeats, and takes no space
_ASIDE = 0.014  # m, by which the arrow stands beside the tip, which would hide it
_TO_THE_RIGHT = np.array([0.89, -0.46, 0.0])  # as the layout looks at the body


@dataclass(frozen=True)
class Frame:
    """State of the robot at one time.

    Attributes
    ----------
    time_s : s since the start of the scan
    link_poses : (l, 7) x, y, z in m and quaternion w, x, y, z of each link in the world
    force_n : N, pressing force, positive into the body
    displacement_m : m, travel of the tip since first touch, inwards positive
    contact_point_m : (3,) m, body frame
    force_vector_n : (3,) N, force on the body, body frame
    surface : gives the (n, 3) displacements in m of the body's surface, body frame, now;
        called only for frames whose shape is drawn
    """

    time_s: float
    link_poses: NDArray[np.float64]
    force_n: float
    displacement_m: float
    contact_point_m: NDArray[np.float64]
    force_vector_n: NDArray[np.float64]
    surface: Callable[[], NDArray[np.float64]] | None = None


class FrameBatch:
    """Gathers frames and sends them column by column, with few shapes of the body's surface.

    A shape is drawn whenever force or travel have changed by a set share of the largest so far;
    the share follows from the number of vertices and presses, so that a recording stays small.

    Parameters
    ----------
    file : RecordingFile
    links : names of the links, in the order of `Frame.link_poses`
    vertices_m, triangles : (n, 3) m and (t, 3), the body's surface at rest
    presses : planned number of presses
    arrow_m_per_n : length of the force arrow, m per N
    """

    def __init__(
        self,
        file: RecordingFile,
        links: Sequence[str],
        vertices_m: NDArray[np.float32],
        triangles: NDArray[np.int32],
        presses: int,
        arrow_m_per_n: float,
    ) -> None:
        self._file = file
        self._links = links
        self._rest = vertices_m
        self._triangles = triangles
        self._arrow = arrow_m_per_n
        shapes = SURFACE_BYTES / (24 * len(vertices_m) * presses) - 1  # one more for its peak
        self._share = 2 / np.clip(shapes, 2, _MOST_SHAPES)
        self._largest = np.zeros(2)  # force and travel, over the whole scan
        self._drawn = np.zeros(2)
        self._before = np.zeros(2)
        self._frames: list[Frame] = []
        self._last_poses: NDArray[np.float64] | None = None  # no frame, which holds the body
        self._shapes: list[tuple[float, NDArray[np.float32]]] = []
        self._peak: tuple[Frame, NDArray[np.float32]] | None = None

    def add(self, frame: Frame) -> None:
        """Keep a frame, and the shape of the surface if it has changed visibly."""
        self._frames.append(frame)
        now = np.abs([frame.force_n, frame.displacement_m])
        self._largest = np.maximum(self._largest, now)
        steady = np.abs(now - self._before) <= _STEADY * self._largest
        self._before = now
        if frame.surface is None or not self._largest.all():
            return
        off = (np.abs(now - self._drawn) / self._largest).max()
        released = _RELEASED * self._largest[0]
        pressed, was_pressed = now[0] > released, self._drawn[0] > released
        if (
            off >= self._share
            or (off >= _OFF and pressed and steady.all())
            or (was_pressed and not pressed)
        ):
            moved = np.round(np.asarray(frame.surface(), float) / _STEP) * _STEP
            shape = self._rest + moved.astype(np.float32)
            self._shapes.append((frame.time_s, shape))
            self._drawn = now
            if self._peak is None or now[0] >= self._peak[0].force_n:
                self._peak = (frame, shape)

    def send(self, press: int | None) -> None:
        """Send all frames on the simulation time, and the one of largest force on the presses.

        Parameters
        ----------
        press : id of the press that the frames belong to; None for frames of no press
        """
        if not self._frames:
            return
        self._send_frames()
        self._send_shapes()
        if press is not None:
            largest = max(self._frames, key=lambda f: f.force_n)
            self._log_at_press(press, *(self._peak or (largest, None)))
        self._last_poses = self._frames[-1].link_poses
        self._frames, self._shapes, self._peak = [], [], None

    def log_last(self, log: Log) -> None:
        """Log the arm's last pose with `log(entity, *archetypes)`."""
        if self._last_poses is not None:
            self._log_links(log, self._last_poses)

    def _send_frames(self) -> None:
        when = [rr.TimeColumn(parts.SIM_TIME, duration=[f.time_s for f in self._frames])]
        poses = np.array([f.link_poses for f in self._frames], np.float32)
        for i, name in enumerate(self._links):
            columns = rr.Transform3D.columns(
                translation=poses[:, i, :3], quaternion=xyzw(poses[:, i, 3:])
            )
            self._file.stream.send_columns(f"{parts.ROBOT}/{name}", when, columns)
        for entity, values in (
            (parts.FORCE, [f.force_n for f in self._frames]),
            (parts.TRAVEL, [1e3 * f.displacement_m for f in self._frames]),
        ):
            self._file.stream.send_columns(entity, when, rr.Scalars.columns(scalars=values))
        self._send_arrows()

    def _send_arrows(self) -> None:
        """Arrows while there is force, and one empty row when it ends."""
        pressing = [f.force_n > _RELEASED * self._largest[0] for f in self._frames]
        kept = [
            (frame, here)
            for i, (frame, here) in enumerate(zip(self._frames, pressing, strict=True))
            if here or i == 0 or pressing[i - 1]
        ]
        arrows = [self._arrow_of(frame) for frame, here in kept if here]
        lengths = [int(here) for _, here in kept]
        columns = rr.Arrows3D.columns(
            origins=np.reshape([a[0] for a in arrows], (-1, 3)),
            vectors=np.reshape([a[1] for a in arrows], (-1, 3)),
            labels=[_newtons(frame) for frame, here in kept if here],
        ).partition(lengths)
        when = [rr.TimeColumn(parts.SIM_TIME, duration=[f.time_s for f, _ in kept])]
        self._file.stream.send_columns(parts.FORCE_ARROW, when, columns)

    def _arrow_of(self, frame: Frame) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Origin and vector of the force on the body; its head is beside the contact point."""
        vector = np.asarray(frame.force_vector_n, float) * self._arrow
        along = vector / max(float(np.linalg.norm(vector)), 1e-30)
        aside = _TO_THE_RIGHT - (_TO_THE_RIGHT @ along) * along
        return np.asarray(frame.contact_point_m) - vector + _ASIDE * aside, vector

    def _send_shapes(self) -> None:
        if not self._shapes:
            return
        shapes = [shape for _, shape in self._shapes]
        counts = [len(self._rest)] * len(shapes)
        columns = rr.Mesh3D.columns(
            vertex_positions=np.concatenate(shapes),
            vertex_normals=np.concatenate([vertex_normals(s, self._triangles) for s in shapes]),
        ).partition(counts)
        when = [rr.TimeColumn(parts.SIM_TIME, duration=[t for t, _ in self._shapes])]
        self._file.stream.send_columns(parts.SURFACE, when, columns)

    def _log_at_press(self, press: int, frame: Frame, shape: NDArray[np.float32] | None) -> None:
        log = self._file.at(press=press)
        self._log_links(log, frame.link_poses)
        origin, vector = self._arrow_of(frame)
        arrow = rr.Arrows3D.from_fields(
            origins=[origin], vectors=[vector], labels=[_newtons(frame)]
        )
        log(parts.FORCE_ARROW, arrow)
        log(parts.FORCE, rr.Scalars(frame.force_n))
        log(parts.TRAVEL, rr.Scalars(1e3 * frame.displacement_m))
        if shape is not None:
            log(
                parts.SURFACE,
                rr.Mesh3D.from_fields(
                    vertex_positions=shape, vertex_normals=vertex_normals(shape, self._triangles)
                ),
            )

    def _log_links(self, log: Log, poses: ArrayLike) -> None:
        poses = np.asarray(poses, np.float32)
        for name, pose in zip(self._links, poses, strict=True):
            log(
                f"{parts.ROBOT}/{name}",
                rr.Transform3D(translation=pose[:3], quaternion=rr.Quaternion(xyzw=xyzw(pose[3:]))),
            )


def _newtons(frame: Frame) -> str:
    return f"{frame.force_n:.2g} N"
