"""From a study and its scan to the experiment that is fitted, and to the selection's start."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from identify import FieldGuess, MapGuess, PlacedExperiment, Progress, silent
from identify.catalogue import CATALOGUE, load_effect
from identify.effects import Effect
from identify.measurement import Noise, scan_noise
from identify.select import StartFit
from models import (
    MOST_OF_FREE_MAP,
    MOST_PRESSES,
    Catalogue,
    Scan,
    thinned,
    touching,
)
from palpmap.study.body_model import build_body_model
from palpmap.study.checks import refuse_unfit
from palpmap.study.frame import frame_shift_m
from palpmap.study.label_file import regions_of
from palpmap.study.placement import place_scan
from palpmap.study.study import Study


@dataclass(frozen=True)
class Problem(StartFit):
    """The selection's start, with the study that it was made from."""

    study: Study = field(kw_only=True)


def open_study(
    study: Study,
    measured: Scan,
    catalogue: Catalogue[Effect] = CATALOGUE,
    thin: bool = True,
    say: Progress = silent,
    noise: Noise | None = None,
) -> PlacedExperiment:
    """Place the scan on the study's body, mesh the body, estimate the noise.

    Presses that met no body (`models.touching`) are left out.

    Parameters
    ----------
    measured : the study's scan, in its own frame
    catalogue : where the study's effects are looked up
    thin : use no more presses than the selection needs (`models.thin`)
    noise : where it is known; else the study's, or estimated

    Raises
    ------
    InputError
        Scan and study do not fit together.
    """
    measured = touching(measured)
    part = thinned(measured, most_presses(study)) if thin else measured
    whole = place_scan(measured, study)
    placement = whole if part is measured else whole.of_presses(part.press_ids)
    refuse_unfit(placement, study)
    used, origin_m = placement.scan.used(), placement.origin_m
    say("meshing the body")

    def in_body_frame(values: Mapping[str, float], prefix: str = "") -> dict[str, float]:
        return {k: v - frame_shift_m(prefix + k, origin_m) for k, v in values.items()}

    body = build_body_model(study, used)
    mesh = body.coarse.mesh
    regions = regions_of(study.map, body.coarse.points_m, mesh.box_m, origin_m)
    return PlacedExperiment(
        placement.scan,
        body,
        noise or scan_noise(used, **study.noise.model_dump()),
        MapGuess(
            "auto" if study.map.kind == "auto" else study.map.inclusions,
            in_body_frame(study.map.initial),
            in_body_frame(study.map.fixed),
            None
            if study.map.kind == "inclusions"
            else FieldGuess(study.map.length_m, study.map.spread, study.map.smoothness, regions),
            study.map.kind == "auto",
        ),
        tuple(
            (catalogue[entry.name], in_body_frame(entry.initial, f"{entry.name}."))
            for entry in study.effects
        ),
        origin_m,
        placement.onto_another_shape,
        None if part is measured else (measured, whole.scan),
        say,
    )


def most_presses(study: Study) -> int:
    """Return the number of presses that the selection uses at most."""
    return MOST_OF_FREE_MAP if study.map.kind == "free" else MOST_PRESSES


def catalogue_with(own: Sequence[Effect]) -> Catalogue[Effect]:
    """Return the built-in effects and the user's own."""
    return Catalogue((*CATALOGUE, *own))


def own_effects(study: Study, files: Sequence[Path] = ()) -> list[Effect]:
    """Return the user's effects that a command or a study names; their files are executed.

    Those of the command come first.
    """
    named = [entry.file for entry in study.effects if entry.file is not None]
    return [load_effect(path) for path in dict.fromkeys(p.resolve() for p in [*files, *named])]
