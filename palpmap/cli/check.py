"""`palpmap check`."""

from typing import TYPE_CHECKING

from palpmap.cli.options import Json, Quiet, StudyFile
from palpmap.console import Output

if TYPE_CHECKING:
    from rich.table import Table

    from palpmap.commands.check import CheckRecord


def check(study: StudyFile, quiet: Quiet = False, json: Json = False) -> None:
    """Read a study and its scan and say what is there.

    Example: palpmap check study.toml
    """
    from palpmap.commands.check import check_study

    found = check_study(study)
    output = Output(quiet=quiet, json=json)
    output.result(found.to_dict(), _table(found))
    for note in found.notes:
        output.say(f"- {note}")
    if found.can_be_fitted and found.doubts:
        output.say("Study and scan can be read; look at the doubtful readings above before a fit.")
    elif found.can_be_fitted:
        output.say("Study and scan can be used.")
    else:
        output.say("Study and scan can be read; the map cannot be fitted yet.")


def _table(found: "CheckRecord") -> "Table":
    from rich import box
    from rich.table import Table

    from identify.effects import percent
    from palpmap.units import shared_errors

    def span(values: tuple[float, float], scale: float, unit: str) -> str:
        return f"{values[0] * scale:.4g} to {values[1] * scale:.4g} {unit}"

    body, noise, placed = found.body, found.noise, found.placement
    size = str(body.file)
    if body.thickness_m is not None:
        size = f"{body.thickness_m * 1e3:g} mm thick"
    if body.size_m is not None:
        size = " x ".join(f"{length * 1e3:g}" for length in body.size_m) + " mm"
    finer = "" if found.inclusions == "free" else ", and finer ones"
    table = Table(title=found.study, box=box.SIMPLE, show_header=False, title_justify="left")
    table.add_row("scan", found.scan)
    table.add_row("body", f"{body.shape}, {size}, Poisson's ratio {body.poisson_ratio:g}")
    table.add_row("finite elements", f"{1e3 * found.cell_size_m:.3g} mm{finer}")
    table.add_row("presses", str(found.presses))
    phases = ", ".join(f"{count} {phase}" for phase, count in found.samples.items())
    table.add_row("rows", f"{found.rows} ({phases}); {found.ignored_rows} ignored")
    radii = ", ".join(f"{float(r) * 1e3:g} mm ({n})" for r, n in found.probe_radius_m.items())
    table.add_row("tip, radius (presses)", f"{found.tip}, {radii}")
    table.add_row("force", span(found.force_n, 1, "N"))
    table.add_row("displacement", span(found.displacement_m, 1e3, "mm"))
    table.add_row("time", span(found.time_s, 1, "s") if found.time_s else "unknown")
    table.add_row(
        "noise (1 sd)",
        ", ".join(
            f"{what} {'unknown' if value is None else f'{value * scale:g} {unit}'}"
            for what, value, scale, unit in (
                ("displacement", noise.displacement_m, 1e6, "µm"),
                ("force", noise.force_n, 1e3, "mN"),
            )
        )
        + shared_errors(noise.touch_m, noise.lag_s),
    )
    table.add_row(
        "contact points",
        f"at most {round(placed.largest_distance_m * 1e3, 3):.3g} mm off the surface, "
        f"{placed.largest_angle_deg:.3g} degrees off its normal",
    )
    any_shape = "none: a free map" if found.inclusions == "free" else str(found.inclusions)
    table.add_row("inclusions in the map", any_shape)
    if found.regions:
        named = (f"{one.label} ({percent(one.share)})" for one in found.regions)
        table.add_row("labels (share of body)", ", ".join(named))
    table.add_row("effects in the model", ", ".join(found.effects) or "none")
    return table
