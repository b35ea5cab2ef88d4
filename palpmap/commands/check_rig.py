"""`palpmap check-rig`: one page on a rig, from approaches and retreats alone."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from models import InputError
from palpmap.console import Output, plain
from palpmap.importing.mapping.rig import load_rig
from palpmap.importing.places import with_places
from palpmap.importing.readers.read import read_recording
from palpmap.importing.streams.rig_check import RigCheck, check_rig
from palpmap.progress import read_stages
from palpmap.report.draw import console, write_page
from palpmap.result.tables import Table


def run_check_rig(*, files: Sequence[Path], rig: Path, out: Path | None, output: Output) -> None:
    """Print the figures of a rig, and write them as a page.

    Raises
    ------
    InputError
        See `palpmap.importing.streams.rig_check.check_rig`.
    """
    mapping = load_rig(rig)
    with output.task(read_stages(len(files))) as task:
        recording, mapping = with_places(read_recording(files, task.say), mapping)
        task.say("finding the presses")
        found = check_rig(recording, mapping)
    figures = figures_table(found, mapping.name)
    if out is not None:
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
            _write(found, mapping.name, figures, out)
        except OSError as error:
            raise InputError(f"{out}: cannot be written ({error.strerror})") from error
    record = {
        "schema": 1, "presses": len(found.time_s), "bias_n": found.bias_n.tolist(),
        "drift_n_per_min": found.drift_n_per_min, "drift_error_n_per_min": found.drift_error,
        "gravity_n": found.gravity_n, "hysteresis_n": found.hysteresis_n,
        "noise_n": found.noise_n, "noise_m": found.noise_m,
        "lag_s": None if found.lag is None else found.offset_s + found.lag.lag_s,
        "lag_error_s": None if found.lag is None else found.lag.error_s,
    }  # fmt: skip
    output.result(record, console(figures), *plain([f"Page: {out}"] if out else []))


def figures_table(found: RigCheck, name: str) -> Table:
    """Return quantity, value and meaning of each figure."""

    def share(force_n: float) -> str:
        return f"{100 * abs(force_n) / found.force_n:.2g} % of a press's largest force"

    duration = float(np.ptp(found.time_s)) / 60
    drift = found.drift_n_per_min
    sure = abs(drift) > 2 * found.drift_error
    lag = found.lag
    rows = [
        ("Presses", str(len(found.time_s)), "with free samples before and after the contact"),
        ("Bias", ", ".join(f"{1e3 * b:.4g}" for b in found.bias_n) + " mN",
         "free force in the sensor's axes, tool's weight included; tared press by press"),
        ("Drift", f"{1e3 * drift:.3g} ± {1e3 * found.drift_error:.2g} mN/min",
         f"{share(drift * duration)} over the recording" if sure else "not seen"),
        ("Residue of gravity",
         "not seen" if found.gravity_n is None else f"{1e3 * found.gravity_n:.3g} mN rms",
         "the tip does not turn" if found.gravity_n is None else
         f"{share(found.gravity_n)}, from press to press after the weight's removal"),
        ("Hysteresis", f"{1e3 * found.hysteresis_n:.3g} mN",
         f"{share(found.hysteresis_n)}, free force after less before"),
        ("Noise of the force", f"{1e3 * found.noise_n:.3g} mN", "one sample, standard deviation"),
        ("Noise of the pose", f"{1e6 * found.noise_m:.3g} µm", "one sample, the noisiest axis"),
        ("Lag", "not seen" if lag is None else
         f"{1e3 * (found.offset_s + lag.lag_s):.1f} ± {1e3 * lag.error_s:.1f} ms",
         "of the force behind the pose" + (f"; {lag.doubt}" if lag and lag.doubt else "")),
    ]  # fmt: skip
    return Table.of(("Quantity", "Value", "Meaning"), rows, name)


def _write(found: RigCheck, name: str, figures: Table, path: Path) -> None:
    from palpmap.figures.free_force import draw_free_force
    from palpmap.figures.style import png
    from palpmap.results import drawn

    write_page(
        path,
        "check_rig.html",
        name=f"Rig: {name}",
        presses=len(found.time_s),
        figures=figures,
        pictures={"free_force": png(drawn(draw_free_force, found))},
        said=found.said,
    )
