"""`palpmap check`: read a study and its scan, and say what is there."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Annotated

import numpy as np
from pydantic import Field, PlainSerializer

from models import PHASES, Doubt, InputError, LabelVolume, Scan, read_scan, scan_findings, touching
from palpmap.console import is_for_the_user
from palpmap.record import FileRecord, Record
from palpmap.result.outline import study_outline
from palpmap.run_folder import sha256
from palpmap.study.body_model import points_of, try_body_model
from palpmap.study.cell_size import cell_size_m, free_map_cell_m, probed_part
from palpmap.study.checks import refuse_contradictions, too_few
from palpmap.study.contact_body import surface_notes
from palpmap.study.faults import naming_study
from palpmap.study.label_file import regions_of
from palpmap.study.placement import Placement, place_scan
from palpmap.study.study import Body, Noise, Study, load_study

SMALL_STRAIN_SHARE = 0.15
SAID = 5  # sentences about doubtful readings before a fit
SLANTED_DEG = 30.0
POINTS_ALONG = 48  # the longest edge, of those that give the shares of labelled regions
FINEST_NOISE = 0.01  # of the smallest step between two readings


Range = tuple[float, float]
Given = PlainSerializer(lambda table: table.model_dump(mode="json", exclude_none=True))


class PlacementRecord(Record):
    """How the presses were put onto the body."""

    projected: bool = Field(description="moved onto a block that stands in for the body")
    largest_distance_m: float = Field(description="off the body's surface, m")
    largest_angle_deg: float = Field(description="off its normal, degrees")


class RegionRecord(Record):
    """A labelled region of the map."""

    label: int
    share: float = Field(description="of the body's volume")


class CheckRecord(FileRecord):
    """Output of `palpmap check --json`."""

    study: str = Field(description="its name")
    scan: str = Field(description="path of the scan's file")
    sha256: Mapping[str, str] = Field(description="of study and scan")
    body: Annotated[Body, Given] = Field(description="as the study gives it")
    cell_size_m: float = Field(description="of the coarser mesh, or of the one under a free map, m")
    presses: int
    rows: int
    ignored_rows: int = Field(description="of approach and retract")
    samples: Mapping[str, int] = Field(description="rows by phase")
    force_n: Range = Field(description="least and largest, N")
    displacement_m: Range = Field(description="least and largest, m")
    time_s: Range | None = Field(description="first and last, s; null of a scan without times")
    tip: str
    probe_radius_m: Mapping[str, int] = Field(description="presses by tip radius in m")
    noise: Noise = Field(description="as the study gives it; null is to be estimated")
    inclusions: int | str = Field(description="number, auto, or free of a map of any shape")
    regions: tuple[RegionRecord, ...] = Field((), description="of a map with labels")
    effects: tuple[str, ...] = Field(description="of the study's model")
    placement: PlacementRecord
    can_be_fitted: bool
    doubts: tuple[Doubt, ...] = Field(description="readings to look at before a fit")
    notes: tuple[str, ...] = Field(description="sentences for the reader")


def check_study(path: str | os.PathLike[str]) -> CheckRecord:
    """Read a study and its scan, place the presses on the body, and sum up the findings.

    Raises
    ------
    InputError
        At the first fault in study or scan.
    """
    study = load_study(path)
    scan = read_scan(study.scan, study.study.units_checked)
    doubts = scan_findings(scan)
    with naming(doubts), naming_study(path):
        placement = place_scan(touching(scan), study)
        refuse_contradictions(placement, study)
        if study.effects:
            _refuse_effects(study, placement)
        regions = regions_of(study.map, *points_of(study.body), placement.origin_m)
        try_body_model(study, placement.scan.used())
    placed = placement.scan
    probed = probed_part(study.body, placed.contact_points, placed.contact_radii)
    used = scan.used()
    radii, presses = np.unique(scan.contact_radii, return_counts=True)
    counts = {phase: int(np.sum(scan.phase == phase)) for phase in PHASES}
    return CheckRecord(
        study=study.name,
        scan=str(study.scan),
        sha256={"study": sha256(path), "scan": sha256(study.scan)},
        body=study.body,
        cell_size_m=free_map_cell_m(study.body, len(scan.press_ids), probed)
        if study.map.kind == "free"
        else cell_size_m(study.body, probed),
        presses=len(scan.press_ids),
        rows=len(scan),
        ignored_rows=scan.ignored_rows,
        samples={phase: count for phase, count in counts.items() if count},
        force_n=_range(used.force_n),
        displacement_m=_range(used.displacement_m),
        time_s=_range(scan.time_s) if scan.has_time else None,
        tip=study.probe.tip,
        probe_radius_m={f"{radius:g}": int(n) for radius, n in zip(radii, presses, strict=True)},
        noise=study.noise,
        inclusions="free" if study.map.kind == "free" else study.map.inclusions,
        regions=() if regions is None else _region_shares(regions, study),
        effects=tuple(effect.name for effect in study.effects),
        placement=PlacementRecord(
            projected=placement.projected,
            largest_distance_m=float(placement.distance_m.max()),
            largest_angle_deg=float(placement.angle_deg.max()),
        ),
        can_be_fitted=too_few(placement, study) is None,
        doubts=tuple(doubts),
        notes=(
            *(doubt.sentence for doubt in doubts),
            *_notes(study, scan, placement, doubts, probed),
        ),
    )


@contextmanager
def naming(doubts: Sequence[Doubt]) -> Iterator[None]:
    """Add press and row of the first reading to be left out to an error."""
    try:
        yield
    except ValueError as error:
        outlying = next((doubt for doubt in doubts if doubt.leaves_out), None)
        if outlying is None or not is_for_the_user(error):
            raise
        raise InputError(
            f"{str(error).rstrip('.')}. Doubtful data may be the cause: {outlying.sentence} "
            "`palpmap fit --without-outliers` leaves such readings and presses out"
        ) from error


def _refuse_effects(study: Study, placement: Placement) -> None:
    """Refuse effects that cannot be fitted; a user's own file is parsed and not executed."""
    from identify.catalogue import CATALOGUE, refuse_effect_file
    from identify.effects import Readings
    from identify.select import refuse_effect

    readings = Readings.of(placement.scan)
    for entry in study.effects:
        if entry.file is None:
            refuse_effect(CATALOGUE[entry.name], readings, entry.initial)
        else:
            refuse_effect_file(entry.file)


def _region_shares(regions: LabelVolume, study: Study) -> tuple[RegionRecord, ...]:
    """Return the labels of a volume with their shares of the body, by points evenly in it."""
    outline = study_outline(study)
    edges = outline.upper_m - outline.lower_m
    axes = [
        low + edge * (np.arange(n) + 0.5) / n
        for low, edge, n in zip(
            outline.lower_m, edges, np.ceil(POINTS_ALONG * edges / edges.max()).astype(int),
            strict=True,
        )
    ]  # fmt: skip
    points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    labels = regions.at(points[outline.inside(points)])
    return tuple(RegionRecord(label=n, share=float(np.mean(labels == n))) for n in regions.names)


def _range(values: np.ndarray) -> Range:
    return float(values.min()), float(values.max())


def _notes(
    study: Study,
    scan: Scan,
    placement: Placement,
    doubts: Sequence[Doubt],
    probed: np.ndarray | None,
) -> list[str]:
    """Sentences about assumptions, ignored data and invisible effects."""
    notes = []
    if few := too_few(placement, study):
        notes.append(f"Not yet enough to fit the map: {few}.")
    if scan.ignored_rows:
        notes.append(f"{scan.ignored_rows} approach and retract rows are not used by models.")
    if placement.projected:
        notes.append(
            "A block stands in for the body: contact points were moved onto its top by up to "
            f"{placement.distance_m.max() * 1e3:.2f} mm and directions turned to its normal by up "
            f"to {placement.angle_deg.max():.1f} degrees."
        )
    if study.body.shape == "from-contacts":
        notes += surface_notes(study.body, placement.distance_m, placement.angle_deg)
    if probed is not None:
        x, y, z = 1e3 * np.ptp(probed, axis=0)
        notes.append(
            f"The presses may show a part of {x:.0f} x {y:.0f} x {z:.0f} mm under them. The "
            "finite elements are wider elsewhere, where the scan tells nothing."
        )
    size = study.body.size_m
    height_m = study.body.thickness_m if size is None else size[2]
    if height_m is not None and study.body.thickness_assumed:
        notes.append(
            f"The thickness of {height_m * 1e3:g} mm is assumed, not measured: depths "
            "and moduli depend on it."
        )
    if not scan.has_time:
        notes.append("No times: creep, drift and other effects in time cannot be seen.")
    readings = study.noise.model_dump(include={"displacement_m", "force_n"})
    unknown = [name for name, value in readings.items() if value is None]
    if unknown:
        notes.append(f"Noise not given for {' and '.join(unknown)}: it will be estimated.")
    notes += _noise_notes(study, scan)
    slanted = int(np.sum(placement.angle_deg > SLANTED_DEG - 1e-3))
    if slanted and not placement.projected:
        notes.append(
            f"{slanted} presses are {SLANTED_DEG:g} degrees or more off the surface's normal (up "
            f"to {placement.angle_deg.max():.0f}): the model takes the whole tip to be in contact."
        )
    other = int(np.sum(~np.isclose(scan.contact_radii, study.probe.radius_m, rtol=1e-3)))
    if other:
        notes.append(f"{other} presses were made with another tip radius than probe.radius_m.")
    if height_m is not None:
        share = _deepest_m(scan, doubts) / height_m
        if share > SMALL_STRAIN_SHARE:
            notes.append(
                f"The tip goes in by {share:.0%} of the body's thickness: beyond about 10 % the "
                "linear model is no longer right."
            )
    return notes


def _deepest_m(scan: Scan, doubts: Sequence[Doubt]) -> float:
    """Return the largest travel in m of the readings whose travel is not itself in doubt."""
    rows = [row for doubt in doubts if doubt.kind == "bad_reading" for row in doubt.rows]
    presses = [press for doubt in doubts if doubt.kind == "free_travel" for press in doubt.presses]
    sound = scan.in_contact & ~np.isin(scan.press, presses)
    sound[rows] = False
    return float(scan.displacement_m[sound].max(initial=0.0))


def _noise_notes(study: Study, scan: Scan) -> list[str]:
    """Say of each stated noise that no reading of such a resolution can have it."""
    notes = []
    for name, unit in (("displacement_m", "m"), ("force_n", "N")):
        values, stated = np.unique(getattr(scan.used(), name)), getattr(study.noise, name)
        steps = np.diff(values)
        steps = steps[steps > 1e-12 * np.abs(values).max()]  # else the rounding of a computer
        if stated is not None and len(steps) and stated < FINEST_NOISE * steps.min():
            notes.append(
                f"noise.{name} is {stated:g} {unit}, far below the smallest step between two "
                f"readings, {steps.min():.2g} {unit}: every test will find structure; state the "
                "sensor's noise, or leave it out to have it estimated."
            )
    return notes
