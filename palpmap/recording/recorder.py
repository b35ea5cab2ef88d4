"""Recording of a run: one .rrd file with the motion of the robot and the result."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from palpmap.recording import entities as names
from palpmap.recording import style as style
from palpmap.recording.fit import log_iteration, log_residuals, send_presses, style_parameters
from palpmap.recording.frames import Frame, FrameBatch
from palpmap.recording.layout import Stage
from palpmap.recording.maps import MapViews, log_map, log_outlines, modulus_colors
from palpmap.recording.page import Page
from palpmap.recording.scene import LinkShape, drawn_shape, lifted, link_names, vertex_normals, xyzw
from palpmap.recording.stream import Log, RecordingFile
from palpmap.version import __version__

if TYPE_CHECKING:
    from identify.fit import FitIteration

_LIFT = 0.004  # m, by which the painted residuals stand off the surface


class Recording:
    """Writes a recording step by step; whatever was flushed survives the end of the process.

    The order is `scene`; then `truth` where it is known; then `frame` and `press_done` for a robot,
    or `measured` for a scan from file; then `iteration` and `comparison` for a fit. Only `scene` is
    a must, and the layout shows the present parts. All of them but `frame` flush the file.

    Three timelines: `sim_time` (the clock of the scan; the iterations follow the last press, one
    second apart), `press` (each press at its largest force), `iteration`.

    Parameters
    ----------
    path : path of the .rrd file; an existing one is replaced
    name : of the run
    seed : seed of the run, if it has one
    planned_presses : presses that the whole run makes
    parts : names of `entities.PARTS` that the whole run has; `palpmap review --summary`
        says which of them are missing
    live : address of a viewer that follows the run
    """

    def __init__(
        self,
        path: str | Path,
        name: str,
        *,
        seed: int | None = None,
        planned_presses: int = 81,
        parts: Sequence[str] = tuple(names.PARTS),
        live: str | None = None,
    ) -> None:
        if unknown := set(parts) - set(names.PARTS):
            raise ValueError(f"unknown parts: {sorted(unknown)}; there are {list(names.PARTS)}")
        self.path = Path(path)
        self._planned = planned_presses
        self._dot_m = 0.001
        self._surface: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
        self._modulus_pa: NDArray[np.float64] | None = None  # true, at the surface's vertices
        self._frames: FrameBatch | None = None
        self._true: MapViews | None = None
        self._true_parameters: dict[str, float] = {}
        self._range_pa: tuple[float, float] | None = None
        self._points: dict[int, NDArray[np.float64]] = {}  # press -> contact point
        self._times: dict[int, float] = {}  # press -> time at which it was read
        self._now = 0.0
        self._last_step: FitIteration | None = None
        self._file = RecordingFile(self.path, name, live)
        self._page = Page(self._file, name)
        run = {"palpmap": __version__, "planned_presses": planned_presses, "parts": list(parts)}
        if seed is not None:
            run["seed"] = seed
        self._file.static(names.RUN, rr.AnyValues(name=name, **run))
        style.style_plots(self._file)
        self._file.flush()

    def __enter__(self) -> "Recording":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is not None:
            self.event(f"the run was stopped by {kind.__name__}: {error}", "ERROR")
        self.close()

    def scene(
        self,
        body_vertices_m: ArrayLike,
        body_triangles: ArrayLike,
        *,
        links: Sequence[LinkShape] = (),
        body_modulus_pa: ArrayLike | None = None,
        body_position_m: ArrayLike = (0.0, 0.0, 0.0),
        body_quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0),
        arrow_m_per_n: float = 0.05,
    ) -> None:
        """Put the body and the arm into the scene.

        Parameters
        ----------
        body_vertices_m, body_triangles : (n, 3) m in the body frame, and (t, 3) indices, outward.
            A coarse surface looks smoother in time: see `frames.SURFACE_BYTES`; more than
            6,000 vertices make a recording larger than 25 MB.
        links : shapes of the arm; a frame has the poses of `link_names(links)`
        body_modulus_pa : (n,) Pa, true Young's modulus at the vertices, to colour them
        body_position_m, body_quaternion : pose of the body frame in the world (w, x, y, z)
        arrow_m_per_n : length of the force arrow per newton
        """
        vertices = np.asarray(body_vertices_m, np.float32)
        triangles = np.asarray(body_triangles, np.int32)
        position = np.asarray(body_position_m, float)
        lower, upper = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)
        self._page.stage = Stage(lower, upper, position)
        self._dot_m = 0.1 * float((upper - lower).max()) / np.sqrt(self._planned)
        rotation = rr.Quaternion(xyzw=xyzw(body_quaternion))
        static, start = self._file.static, self._file.at(sim_time=0, press=0, iteration=0)
        static(names.BODY, rr.Transform3D(translation=position, quaternion=rotation))
        static(names.SURFACE, rr.Mesh3D.from_fields(triangle_indices=triangles))
        normals = vertex_normals(vertices, triangles)
        self._surface = vertices, normals
        start(
            names.SURFACE,
            rr.Mesh3D.from_fields(vertex_positions=vertices, vertex_normals=normals),
        )
        static(
            f"{names.RESIDUAL_MAP}/body",
            rr.Mesh3D(
                vertex_positions=vertices,
                triangle_indices=triangles,
                vertex_normals=normals,
                albedo_factor=style.DARK_GREY,
            ),
        )
        for i, shape in enumerate(links):
            static(f"{names.ROBOT}/{shape.link}/{i}_{shape.kind}", drawn_shape(shape))
        if links:
            self._frames = FrameBatch(
                self._file, link_names(links), vertices, triangles, self._planned, arrow_m_per_n
            )
        self._modulus_pa = None if body_modulus_pa is None else np.asarray(body_modulus_pa, float)
        self._color_body(start, len(vertices))
        self._step_done("body", *["robot"] * bool(links))

    def _color_body(self, log: Log, vertices: int) -> None:
        """Colour the surface by its true modulus on the scale of the maps; grey if unknown."""
        colors = np.tile(np.array(style.GREY, np.uint8), (vertices, 1))
        if self._modulus_pa is not None:
            own = (float(self._modulus_pa.min()), float(self._modulus_pa.max()))
            colors = modulus_colors(self._modulus_pa, self._range_pa or own)
        log(names.SURFACE, rr.Mesh3D.from_fields(vertex_colors=colors))

    def truth(self, views: MapViews, parameters: Mapping[str, float] | None = None) -> None:
        """Show the true map of a virtual laboratory; its range becomes the colour scale.

        Parameters
        ----------
        views : see `maps.map_views`
        parameters : true values by name, drawn beside the estimates
        """
        self._true = views
        self._true_parameters = dict(parameters or {})
        self._range_pa = views.range_pa
        log_map(self._file.static, names.TRUE_MAP, views, self._range_pa)
        log_outlines(self._file.static, names.TRUE_MAP, self._true_parameters, views, style.TRUE)
        if self._modulus_pa is not None:
            start = self._file.at(sim_time=0, press=0, iteration=0)
            self._color_body(start, len(self._modulus_pa))
        self._step_done("truth")

    def frame(self, frame: Frame) -> None:
        """Keep a robot frame; it is written with `press_done`."""
        if self._frames is None:
            raise ValueError("frames need the arm: call scene(..., links=...) first")
        self._frames.add(frame)
        self._now = max(self._now, frame.time_s)

    def press_done(
        self,
        press: int,
        time_s: float,
        contact_point_m: ArrayLike,
        force_n: float,
        displacement_m: float,
    ) -> None:
        """Write a finished press with all frames since the last one.

        Parameters
        ----------
        press : id of the press
        time_s : s, when the values were read
        contact_point_m : (3,) m, body frame
        force_n, displacement_m : N and m, settled pair
        """
        if self._frames is not None:
            self._frames.send(press)
        self._now = max(self._now, time_s)
        self._times[press] = time_s
        self._points[press] = np.asarray(contact_point_m, float)
        log = self._file.at(sim_time=time_s, press=press)
        log(names.MEASURED, rr.Scalars(1e3 * displacement_m))
        self._log_points(log)
        self.event(f"press {press}: {force_n:.4g} N, {1e3 * displacement_m:.4g} mm", "INFO", time_s)
        self._step_done("presses")

    def measured(
        self,
        press_ids: Sequence[int] | NDArray[np.int64],
        contact_points_m: ArrayLike,
        displacement_m: ArrayLike,
        times_s: ArrayLike | None = None,
    ) -> None:
        """Write all presses of a scan that comes from a file.

        Parameters
        ----------
        press_ids : (j,) ids
        contact_points_m : (j, 3) m, body frame
        displacement_m : (j,) m, at the largest force of each press
        times_s : (j,) s since the start; without a clock the presses stand one second apart
        """
        times = np.arange(len(press_ids), dtype=float)
        if times_s is not None and np.isfinite(times_s).all():
            times = np.asarray(times_s, float)
        ids = np.asarray(press_ids, np.int64)
        self._times = dict(zip(ids.tolist(), times.tolist(), strict=True))
        self._points = dict(zip(ids.tolist(), np.asarray(contact_points_m, float), strict=True))
        self._now = float(times.max())
        self._send_presses(names.MEASURED, ids, 1e3 * np.asarray(displacement_m, float))
        self._log_points(self._file.at(sim_time=0, press=int(ids.min())))
        self._step_done("presses")

    def _send_presses(
        self, entity: str, ids: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        send_presses(self._file, entity, ids, [self._times[p] for p in ids.tolist()], values)

    def _log_points(self, log: Log) -> None:
        points = np.array(list(self._points.values()))
        log(names.PRESSES_MADE, rr.Points3D(points, radii=self._dot_m, colors=style.TRUE))

    def iteration(
        self,
        step: "FitIteration",
        views: MapViews | None = None,
        surface_modulus_pa: ArrayLike | None = None,
    ) -> None:
        """Write one step of the fit.

        Parameters
        ----------
        step : iteration number, parameters by name, chi-square per degree of freedom, rms in m
        views : the map of these parameters, see `maps.map_views`
        surface_modulus_pa : (n,) Pa at the vertices of the surface, to colour the body by the
            estimate where the truth is not known
        """
        if self._last_step is None:
            style_parameters(self._file, list(step.parameters), list(self._true_parameters))
            log = self._file.at(iteration=step.iteration)
            if self._frames is not None:
                self._frames.send(None)
                self._frames.log_last(log)
            if self._points:
                self._log_points(log)
        self._last_step = step
        self._now += 1.0
        log = self._end()
        log_iteration(log, step, self._true_parameters)
        if views is not None:
            self.found(views)
            log_outlines(log, names.FOUND_MAP, step.parameters, views, style.FOUND)
        if surface_modulus_pa is not None and self._range_pa is not None:
            colors = modulus_colors(surface_modulus_pa, self._range_pa)
            log(names.SURFACE, rr.Mesh3D.from_fields(vertex_colors=colors))
        self._step_done("fit")

    def found(self, views: MapViews) -> None:
        """Write the found map, without a truth on a colour scale of its own."""
        self._range_pa = views.range_pa if self._true is None else self._range_pa
        log_map(self._end(), names.FOUND_MAP, views, self._range_pa or views.range_pa)

    def comparison(
        self,
        press_ids: Sequence[int] | NDArray[np.int64],
        modelled_m: ArrayLike,
        residual_m: ArrayLike,
        figures: Mapping[str, Path] | None = None,
    ) -> None:
        """Write the modelled displacement of each recorded press, and the map of the residuals.

        Parameters
        ----------
        press_ids : (j,) ids of presses that were recorded
        modelled_m : (j,) m, modelled displacement at the force of the recorded one
        residual_m : (j,) m, measured - modelled
        figures : name -> PNG file, each shown in a tab
        """
        ids = np.asarray(press_ids, np.int64)
        if unknown := sorted(set(ids.tolist()) - set(self._times)):
            raise ValueError(f"presses {unknown[:5]} are compared but were not recorded")
        residual_um = 1e6 * np.asarray(residual_m, float)
        self._send_presses(names.MODELLED, ids, 1e3 * np.asarray(modelled_m, float))
        self._send_presses(names.RESIDUAL, ids, residual_um)
        points = np.array([self._points[p] for p in ids.tolist()])
        if self._surface is not None:
            points = lifted(points, *self._surface, _LIFT)
        limit = self._page.residual_limit_um = float(np.abs(residual_um).max())
        log_residuals(self._end(), ids, points, residual_um, limit)
        for name, path in (figures or {}).items():
            self._file.static(f"{names.FIGURES}/{name}", rr.EncodedImage(path=path))
        self._page.figures = list(figures or {})
        self._step_done("comparison")

    def event(self, text: str, level: str = "INFO", time_s: float | None = None) -> None:
        """Write a line of the event log, at `time_s` or now; INFO, WARN or ERROR."""
        log = self._end(time_s)
        log(names.EVENTS, rr.TextLog(text, level=level))
        self._file.flush()

    def close(self) -> None:
        """End the recording; one without this end is known as the recording of a stopped run."""
        if self._frames is not None:
            self._frames.send(None)
        self._file.close()

    def _end(self, time_s: float | None = None) -> Log:
        """Bind a place at the present end of all timelines."""
        return self._file.at(
            sim_time=self._now if time_s is None else time_s,
            press=list(self._times)[-1] if self._times else 0,
            iteration=self._last_step.iteration if self._last_step else 0,
        )

    def _step_done(self, *parts: str) -> None:
        """Bring text and layout up to date, and flush."""
        found = self._last_step.parameters if self._last_step else {}
        self._page.show(parts, found, self._true_parameters)
        self._file.flush()
