"""`palpmap check-rig`: one page on a rig, from approaches and retreats alone."""

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from models import InputError, replaced
from palpmap.console import Output
from palpmap.importing.mapping.rig import load_rig
from palpmap.importing.readers.read import read_recording
from palpmap.importing.streams.rig_check import RigCheck, check_rig

Row = tuple[str, str, str]


def run_check_rig(*, files: Sequence[Path], rig: Path, out: Path | None, output: Output) -> None:
    """Print the figures of a rig, and write them as a page.

    Raises
    ------
    InputError
        See `palpmap.importing.streams.rig_check.check_rig`.
    """
    from rich.markup import escape as plain
    from rich.table import Table

    mapping = load_rig(rig)
    found = check_rig(read_recording(files), mapping)
    rows = rows_of(found)
    table = Table("Quantity", "Value", "Meaning", title=mapping.name)
    for row in rows:
        table.add_row(*map(plain, row))
    last = []
    if out is not None:
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
            with replaced(out) as beside:
                beside.write_text(page(found, mapping.name, rows), encoding="utf-8")
        except OSError as error:
            raise InputError(f"{out}: cannot be written ({error.strerror})") from error
        last = [f"Page: {plain(str(out))}"]
    record = {
        "schema": 1, "presses": len(found.time_s), "bias_n": found.bias_n.tolist(),
        "drift_n_per_min": found.drift_n_per_min, "drift_error_n_per_min": found.drift_error,
        "gravity_n": found.gravity_n, "hysteresis_n": found.hysteresis_n,
        "noise_n": found.noise_n, "noise_m": found.noise_m,
        "lag_s": None if found.lag is None else found.offset_s + found.lag.lag_s,
        "lag_error_s": None if found.lag is None else found.lag.error_s,
    }  # fmt: skip
    output.result(record, table, *last)


def rows_of(found: RigCheck) -> list[Row]:
    """Return quantity, value and meaning of each figure."""

    def share(force_n: float) -> str:
        return f"{100 * abs(force_n) / found.force_n:.2g} % of a press's largest force"

    duration = float(np.ptp(found.time_s)) / 60
    drift = found.drift_n_per_min
    sure = abs(drift) > 2 * found.drift_error
    lag = found.lag
    return [
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
         f"{1e3 * (found.offset_s + lag.lag_s):.4g} ± {1e3 * lag.error_s:.2g} ms",
         "of the force behind the pose" + ("" if lag is None or lag.has_corners else
         "; the tip starts and stops softly, viscosity looks alike")),
    ]  # fmt: skip


def page(found: RigCheck, name: str, rows: Sequence[Row]) -> str:
    """Return the page as HTML, with a picture of the free force."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    from palpmap.figures.style import STYLE, png

    with rc_context(STYLE):
        figure = Figure(figsize=(7, 3), layout="constrained")
        axes = figure.subplots()
        axes.plot(found.time_s, 1e3 * found.before_n, "o", label="before the contact")
        axes.plot(found.time_s, 1e3 * found.after_n, "x", label="after it")
        axes.set_xlabel("time, s")
        axes.set_ylabel("free force, mN")
        figure.legend(loc="outside upper right", ncols=2)
        picture = b64encode(png(figure)).decode()
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    said = "".join(f"<li>{escape(sentence)}</li>" for sentence in found.said)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Rig: {escape(name)}</title>
<meta name="viewport" content="width=device-width">
<style>body {{ font: 16px/1.5 sans-serif; max-width: 50em; margin: 2em auto; padding: 0 1em }}
table {{ border-collapse: collapse; width: 100% }} td, th {{ text-align: left; padding: .3em .6em;
border-bottom: 1px solid #ccc; overflow-wrap: anywhere }} img {{ max-width: 100% }}</style></head>
<body><h1>Rig: {escape(name)}</h1>
<p>By the approaches and retreats of {len(found.time_s)} presses; forces along the direction of
pressing.</p>
<table><tr><th>Quantity</th><th>Value</th><th>Meaning</th></tr>{body}</table>
<h2>Free force, press by press</h2>
<p>With the tool's weight and the sensor's bias.</p>
<img alt="free force before and after each contact" src="data:image/png;base64,{picture}">
<h2>Found in the recording</h2><ul>{said}</ul></body></html>
"""
