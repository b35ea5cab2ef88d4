"""The virtual laboratory: a planned scan, the body under it, the presses of the robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from identify.map import GaussianMap
from models import InputError, Scan, stack_scans
from palpmap.study.body import Body
from palpmap.study.body_model import support_of
from palpmap.study.press_plan import probe_of
from palpmap.study.study import About, Map, Noise, Probe, Study
from palpmap.study.truth_file import Truth

if TYPE_CHECKING:
    from sim.body import SoftBody, TruthMap
    from sim.motion import BodySurface, Motion, ScanPlan, ScanSettings
    from sim.scan import Frame, PressOutcome, PressResult, RobotPlant, ScanRun

MOST_FORCE_N = 1.0  # of the presses that are proposed; the paper presses with 3 N


@dataclass(frozen=True)
class Laboratory:
    """A scan that is planned but not yet made.

    Attributes
    ----------
    plan, settings : how it is made
    body : with the true map and the hidden effects in it
    hidden : hidden effects
    inclusions : of the true map without what is hidden
    motion : of the arm, None is planned when the scan is made
    """

    plan: ScanPlan
    settings: ScanSettings
    body: SoftBody
    hidden: RobotPlant
    inclusions: int
    motion: Motion | None = None

    @property
    def truth(self) -> TruthMap:
        """The true map, with planted inclusions."""
        return self.hidden.body.truth

    def within_depth(self) -> Laboratory:
        """Return the laboratory with less force where a press would go too deep."""
        from sim.motion import lowered

        return replace(self, plan=lowered(self.plan, self.body, self.settings))

    def press(
        self,
        on_frame: Callable[[Frame], None] | None = None,
        on_press: Callable[[PressResult, Scan], None] | None = None,
        on_outcome: Callable[[PressOutcome], None] | None = None,
    ) -> tuple[ScanRun, Scan]:
        """Make all presses; return how they went, and the readings that the robot reports.

        Readings are in the frame of the scan, what goes on in the robot in that of the body.

        Parameters
        ----------
        on_frame : called with each picture of the running scan
        on_press : called after each press that was made, with all reported readings so far
        on_outcome : called for every planned press with what became of it

        Raises
        ------
        InputError
            No press could be made.
        """
        from sim.scan import run_scan

        done: list[Scan] = []
        origin_m = np.array(self.plan.origin_m)

        def reported(result: PressResult) -> None:
            done.append(self.hidden.report(result.scan).moved(origin_m))
            if on_press:
                on_press(result, stack_scans(done))

        made = run_scan(
            self.plan,
            self.body,
            self.settings,
            on_frame,
            reported,
            on_outcome,
            self.hidden.mechanisms,
            self.motion,
        )
        if not done:
            first = made.outcomes[0]
            raise InputError(
                f"none of {len(made.outcomes)} presses could be made. {first.sentence}"
            )
        return made, stack_scans(done)


def build_laboratory(
    study: Study,
    plan: ScanPlan,
    settings: ScanSettings,
    plant: Sequence[tuple[str, float]] = (),
    truth: Truth | None = None,
    motion: Motion | None = None,
) -> Laboratory:
    """Solve the body of a planned scan.

    Parameters
    ----------
    plant : effects to hide, with their sizes
    truth : of the body, with the scans before whose effects act again; None is `default_truth`
    motion : of the plan, where it is known already
    """
    from sim.body import HiddenBody, SoftBody
    from sim.scan import Earlier, plant_on_robot

    truth = truth or Truth(default_truth(plan.body, settings.seed))
    block, earlier = study.body.size_m, truth.earlier or Earlier()

    def solved(modulus: Callable[[np.ndarray], np.ndarray], poisson_ratio: float) -> SoftBody:
        return SoftBody(
            block or (plan.body.vertices_m, plan.body.triangles),
            modulus,
            poisson_ratio,
            [plan.tip_of(press) for press in range(len(plan))],
            plan.points_m,
            plan.directions,
            support=support_of(study.body),
            force_n=np.array([plan.force_of(press) for press in range(len(plan))]),
            law=truth.law,
            sticking=truth.sticking,
            creep=truth.creep,
            bend_per_m=plan.body.bends(plan.points_m, -plan.directions, 0.5 * plan.radii_m),
        )

    ratio = study.body.poisson_ratio
    if block is None:  # what is planted leaves its build alone
        body = solved(truth.map, ratio)
        known = HiddenBody(tuple(plan.body.extent_m), ratio, truth.map, solved=tuple(body.curves))
        hidden = plant_on_robot(plant, plan, settings, known, earlier)
    else:
        hidden = plant_on_robot(plant, plan, settings, HiddenBody(block, ratio, truth.map), earlier)
        modulus = hidden.pressed.modulus if hidden.records else truth.map
        body = solved(modulus, hidden.pressed.poisson_ratio)
    return Laboratory(plan, settings, body, hidden, len(truth.map.inclusions), motion)


def known_of(study: Study, scan: Path, laboratory: Laboratory) -> Study:
    """Return the facts known before a scan: noise, number of inclusions, tip, place."""
    settings = laboratory.settings
    noise = Noise(displacement_m=settings.displacement_noise_m, force_n=settings.force_noise_n)
    plan, most = laboratory.plan, study.probe.most_force_n
    if most is not None:  # a force that was asked for is borne
        most = max(most, *(plan.force_of(press) for press in range(len(plan))))
    return study.model_copy(
        update={
            "study": About(name=study.name, scan=scan.resolve()),  # pyright: ignore[reportCallIssue]
            "noise": noise,
            "map": Map(inclusions=laboratory.inclusions),
            "probe": probe_of(plan).model_copy(update={"most_force_n": most}),
        }
    )


def with_touch_error(study: Study, made: ScanRun) -> Study:
    """Return the study with the error of first touch that the robot states for its presses."""
    noise = study.noise.with_touch([press.judged.touch_sd_m for press in made.presses])
    return study.model_copy(update={"noise": noise})


def default_study() -> Study:
    """Return the study of the built-in phantom: the paper's block, a flat tip of 5 mm."""
    return Study(
        study=About(name="virtual phantom", scan=Path("scan.csv")),  # pyright: ignore[reportCallIssue]
        body=Body(shape="block", size_m=(0.096, 0.096, 0.048), poisson_ratio=0.49),  # pyright: ignore[reportCallIssue]
        probe=Probe(tip="flat", radius_m=0.005, most_force_n=MOST_FORCE_N),
    )


def default_truth(surface: BodySurface, seed: int = 0) -> TruthMap:
    """Return the phantom's map scaled into a body, or one drawn by seed where it does not fit."""
    from sim.body import drawn_truth

    scaled = _scaled_truth(tuple(surface.extent_m), surface.lowest_m)
    centres = np.array([inclusion.centre_m for inclusion in scaled.inclusions])
    block = len(surface.triangles) == 12
    return scaled if block and surface.contains(centres).all() else drawn_truth(surface, seed)


def truth_of(found: GaussianMap, origin_m: np.ndarray | float = 0.0) -> TruthMap:
    """Return a map as the laboratory knows it, moved into the body's frame."""
    from sim.body import Inclusion, TruthMap

    spots = (
        (i.weight_pa, tuple(np.array([i.x_m, i.y_m, i.z_m]) - origin_m), i.radius_m)
        for i in found.inclusions
    )
    return TruthMap(found.background_pa, tuple(Inclusion(*spot) for spot in spots))


def _scaled_truth(size: tuple[float, ...], low: np.ndarray) -> TruthMap:
    """Return the phantom's true map, its inclusion moved and scaled with the body."""
    from sim.body import Inclusion, TruthMap

    default, paper = TruthMap(), (0.096, 0.096, 0.048)
    share = [s / p for s, p in zip(size, paper, strict=True)]
    inclusions = tuple(
        Inclusion(
            inclusion.weight_pa,
            tuple(o + c * s for o, c, s in zip(low, inclusion.centre_m, share, strict=True)),  # pyright: ignore[reportArgumentType]
            inclusion.radius_m * min(share),
        )
        for inclusion in default.inclusions
    )
    return TruthMap(default.background_pa, inclusions)
