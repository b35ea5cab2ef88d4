"""The virtual laboratory: a planned scan, the body under it, the presses of the robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from models import InputError, Scan, stack_scans
from palpmap.study.body import Body
from palpmap.study.study import About, Map, Noise, Probe, Study

if TYPE_CHECKING:
    from models import PressProgram
    from sim.body import SoftBody, TruthMap
    from sim.motion import ScanPlan, ScanSettings
    from sim.scan import Frame, PressOutcome, PressResult, RobotPlant, ScanRun

DEFAULT_FORCE_N = 0.3
PRESSES_PER_SIDE = 9
MARGIN_SHARE = 1 / 8  # of the body's edges, from the rim to the first presses: 12 of 96 mm


@dataclass(frozen=True)
class Laboratory:
    """A scan that is planned but not yet made.

    Attributes
    ----------
    plan, settings : how it is made
    body : with the true map and the hidden effects in it
    hidden : hidden effects
    inclusions : of the true map without what is hidden
    """

    plan: ScanPlan
    settings: ScanSettings
    body: SoftBody
    hidden: RobotPlant
    inclusions: int

    @property
    def truth(self) -> TruthMap:
        """The true map, with planted inclusions."""
        return self.hidden.body.truth

    def press(
        self,
        on_frame: Callable[[Frame], None] | None = None,
        on_press: Callable[[PressResult, Scan], None] | None = None,
        on_outcome: Callable[[PressOutcome], None] | None = None,
    ) -> tuple[ScanRun, Scan]:
        """Make all presses; return how they went, and the readings that the robot reports.

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

        def reported(result: PressResult) -> None:
            start = done[0].time_s[0] if done else result.scan.time_s[0]
            done.append(self.hidden.report(result.scan, float(start)))
            if on_press:
                on_press(result, stack_scans(done))

        made = run_scan(self.plan, self.body, self.settings, on_frame, reported, on_outcome)
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
    truth: TruthMap | None = None,
) -> Laboratory:
    """Solve the body of a planned scan.

    Parameters
    ----------
    plant : effects to hide, with their sizes
    truth : map in the body's frame; None scales the phantom's into the body
    """
    from sim.body import HiddenBody, SoftBody
    from sim.scan import plant_on_robot

    size = block_of(study)
    truth = truth or scaled_truth(size)
    hidden = plant_on_robot(
        plant, plan, settings, HiddenBody(size, study.body.poisson_ratio, truth)
    )
    body = SoftBody(
        size,
        hidden.body.modulus if plant else truth,
        hidden.body.poisson_ratio,
        plan.tip_radius_m,
        plan.points_m,
        plan.directions,
    )
    return Laboratory(plan, settings, body, hidden, len(truth.inclusions))


def known_of(study: Study, scan: Path, laboratory: Laboratory) -> Study:
    """Return the facts known before a scan: noise, number of inclusions, tip, place."""
    settings = laboratory.settings
    noise = Noise(displacement_m=settings.displacement_noise_m, force_n=settings.force_noise_n)
    return study.model_copy(
        update={
            "study": About(name=study.name, scan=scan.resolve()),  # pyright: ignore[reportCallIssue]
            "noise": noise,
            "map": Map(inclusions=laboratory.inclusions),
            "body": study.body.model_copy(update={"origin_m": (0.0, 0.0, 0.0)}),
            "probe": Probe(tip="flat", radius_m=laboratory.plan.tip_radius_m),
        }
    )


def default_study() -> Study:
    """Return the study of the built-in phantom: the paper's block, a flat tip of 5 mm."""
    return Study(
        study=About(name="virtual phantom", scan=Path("scan.csv")),  # pyright: ignore[reportCallIssue]
        body=Body(shape="block", size_m=(0.096, 0.096, 0.048), poisson_ratio=0.49),  # pyright: ignore[reportCallIssue]
        probe=Probe(tip="flat", radius_m=0.005),
    )


def grid_plan_of(study: Study, force_n: float, per_side: int) -> ScanPlan:
    """Plan a grid of presses on a study's block, row by row.

    Raises
    ------
    InputError
        A study whose body or tip the laboratory does not have.
    """
    from sim.motion import ScanPlan

    size = block_of(study)
    points = _grid(size, per_side)
    down = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    return ScanPlan(
        points, down, force_n=force_n, tip_radius_m=study.probe.radius_m, body_size_m=size
    )


def program_plan_of(study: Study, program: PressProgram, **settings: object) -> ScanPlan:
    """Plan the presses of a program, which is in the study's frame, on the study's block.

    Raises
    ------
    InputError
        A study whose body or tip the laboratory does not have, presses beside the block, or tips
        of several radii.
    """
    from sim.motion import program_plan

    size = block_of(study)
    x, y, _ = study.body.origin_m
    moved = replace(program, x_m=program.x_m - x, y_m=program.y_m - y)
    return program_plan(moved, size, **settings)


def scaled_truth(size: tuple[float, float, float]) -> TruthMap:
    """Return the phantom's true map, its inclusion moved and scaled with the body."""
    from sim.body import Inclusion, TruthMap

    default, paper = TruthMap(), (0.096, 0.096, 0.048)
    share = [s / p for s, p in zip(size, paper, strict=True)]
    inclusions = tuple(
        Inclusion(
            inclusion.weight_pa,
            tuple(c * s for c, s in zip(inclusion.centre_m, share, strict=True)),  # pyright: ignore[reportArgumentType]
            inclusion.radius_m * min(share),
        )
        for inclusion in default.inclusions
    )
    return TruthMap(default.background_pa, inclusions)


def block_of(study: Study) -> tuple[float, float, float]:
    """Edges of a study's block, if it is one that the laboratory has, with a tip that it has."""
    if study.body.size_m is None:
        raise InputError(
            f'the laboratory presses on blocks; the study has body.shape = "{study.body.shape}": '
            "give a study of a block to scan"
        )
    if study.body.support != "base-bonded" or study.body.held_sides:
        raise InputError(
            "the laboratory's body is bonded at its base and free elsewhere; the study has "
            f'body.support = "{study.body.support}" and held_sides = '
            f'{list(study.body.held_sides)}: give support = "base-bonded" and no held_sides to scan'
        )
    if study.probe.tip != "flat":
        raise InputError(
            'the laboratory presses with a flat tip; the study has probe.tip = "sphere": give '
            'probe.tip = "flat" to scan'
        )
    return study.body.size_m


def _grid(size: tuple[float, float, float], per_side: int) -> np.ndarray:
    """Points of the presses, row by row to and fro, (j, 3) m."""
    x, y = (np.linspace(MARGIN_SHARE * s, (1 - MARGIN_SHARE) * s, per_side) for s in size[:2])
    rows = [(xi, yk, size[2]) for k, yk in enumerate(y) for xi in (x if k % 2 == 0 else x[::-1])]
    return np.array(rows)
