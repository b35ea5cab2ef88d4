"""A scan with hidden effects, and their record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from models import InputError, PressProgram, Scan, grid_program
from sim.bench.amplitude_search import amplitude_for, size_of
from sim.bench.press import DISPLACEMENT_NOISE_M, FORCE_NOISE_N, Planted, press, record
from sim.body.soft_body import DIVISIONS, Divisions
from sim.body.true_body import PAPER_SIZE_M, HiddenBody
from sim.body.true_map import Inclusion, TruthMap
from sim.planted.bench import Bench
from sim.planted.catalogue import HIDDEN

BETWEEN_SCANS_S = 60.0  # to change the tip
DEFAULT_MAP = TruthMap(5500.0, (Inclusion(20000.0, (0.042, 0.056, 0.034), 0.010),))


def planted_scan(
    effect: str | Sequence[str] | None,
    size: float | Sequence[float] = 0.03,
    seed: int = 0,
    radii: tuple[float, ...] = (0.005,),
    truth: TruthMap = DEFAULT_MAP,
    program: PressProgram | None = None,
    values: dict[str, float] | None = None,
    noise: tuple[float, float] = (DISPLACEMENT_NOISE_M, FORCE_NOISE_N),
    size_m: tuple[float, float, float] = PAPER_SIZE_M,
    divisions: Divisions = DIVISIONS,
    poisson_ratio: float = HiddenBody.poisson_ratio,
    **grid: Any,
) -> tuple[Scan, dict[str, Any]]:
    """Make a scan of a block, the paper's by default, with effects hidden in it.

    The first call for a grid and its radii sets up the truth's finite elements (seconds); later
    ones cost milliseconds for the same map, and one or more solutions where the body changes.

    Parameters
    ----------
    effect : name in `sim.planted.catalogue`, several, or None
    size : rms(with - without)/rms(without) of each effect, such as 0.03
    seed : of the noise, the pauses and the drawn values of the effects
    radii : of the tips, m; two take turns from press to press
    truth : the map
    program : the presses; a grid of 9 x 9 with 0.3 N if None
    values : of the effects, by name, in place of drawn ones; with the amplitude among them the
        size is not searched
    noise : one standard deviation of displacement (m) and force (N)
    size_m : edges of the block
    divisions : of the truth's finer mesh
    poisson_ratio : of the block
    **grid : of `models.press_program.grid_program`, where no program is given

    Returns
    -------
    The scan, and its truth: `effects` (each with name, category, law, values, size wanted and
    reached), `body`, `size_m`, `poisson_ratio`, `divisions`, `seed`, `radii_m`, `noise`, `program`
    (column by column), `compliance_m_per_n` of every press as it was made.
    """
    names = [effect] if isinstance(effect, str) else list(effect or ())
    sizes = np.broadcast_to(np.asarray(size, float), len(names))
    program = program or grid_program(size_m, radii_m=radii, seed=seed, **grid)
    bench = Bench(program, HiddenBody(size_m, poisson_ratio, truth), divisions=divisions)
    rng = np.random.default_rng([seed, 3])
    planted: tuple[Planted, ...] = ()
    records = []
    for name, wanted in zip(names, sizes, strict=True):
        one, reached = _plant(bench, name, float(wanted), rng, planted, values or {})
        planted = (*planted, one)
        records.append(
            {
                "name": name,
                "category": one[0].category,
                "law": one[0].law,
                "values": dict(one[1]),
                "wanted_size": float(wanted),
                "size": reached,
            }
        )
    scan = record(bench, press(bench, planted), seed, *noise)
    return scan, {
        "effects": records,
        "body": truth.record(),
        "size_m": size_m,
        "poisson_ratio": poisson_ratio,
        "divisions": divisions,
        "seed": seed,
        "noise": {"displacement_m": noise[0], "force_n": noise[1]},
        **_pressed_record(bench, planted),
    }


def further_scan(
    answer: Mapping[str, Any],
    program: PressProgram,
    rest_s: float = BETWEEN_SCANS_S,
) -> tuple[Scan, dict[str, Any]]:
    """Press the body of an earlier scan once more, with its hidden effects.

    Clock, order of presses and all that has a memory go on from the last press that was made.

    Parameters
    ----------
    answer : the truth that came with the scan before, see `planted_scan`
    program : the further presses
    rest_s : between the two

    Returns
    -------
    The scan of the further presses alone, numbered on, and the truth of all presses together.

    Raises
    ------
    InputError
        A press beside the block, or an answer of a version that did not keep its presses.
    """
    if "program" not in answer:
        raise InputError(
            "the trial was made by an older palpmap, which did not keep its presses; make it anew "
            "with palpmap blind"
        )
    earlier = PressProgram(**{name: np.array(v) for name, v in answer["program"].items()})
    x, y, z = answer.get("size_m") or PAPER_SIZE_M
    poisson_ratio = answer.get("poisson_ratio") or HiddenBody.poisson_ratio
    body = HiddenBody((x, y, z), poisson_ratio, _map_from(answer["body"]))
    _on_top(program, body)
    nx, ny, nz = answer.get("divisions") or DIVISIONS
    bench = Bench(earlier.then(program, rest_s), body, divisions=(nx, ny, nz))
    planted = tuple((HIDDEN[e["name"]], e["values"]) for e in answer["effects"])
    noise = answer["noise"]["displacement_m"], answer["noise"]["force_n"]
    seed = np.random.SeedSequence([answer["seed"], 6, len(earlier)]).generate_state(1)[0]
    scan = record(bench, press(bench, planted), int(seed), *noise)
    truth = {**answer, **_pressed_record(bench, planted)}
    return scan.rows(scan.press >= len(earlier)), truth


def _pressed_record(bench: Bench, planted: tuple[Planted, ...]) -> dict[str, Any]:
    body = bench.body
    for hidden, values in planted:
        body = hidden.body(body, values)
    program = bench.program
    return {
        "radii_m": sorted(set(program.radius_m.tolist())),
        "program": {
            f.name: column.tolist()
            for f in fields(program)
            if not np.isnan(column := getattr(program, f.name)).all()
        },
        "compliance_m_per_n": bench.compliance(body=body).tolist(),
    }


def _on_top(program: PressProgram, body: HiddenBody) -> None:
    """Refuse presses whose rim is not on the block's top."""
    for axis, at in enumerate((program.x_m, program.y_m)):
        off = (at < program.radius_m) | (at > body.size_m[axis] - program.radius_m)
        if off.any():
            j = int(off.argmax())
            raise InputError(
                f"Press {j} of the program: {'xy'[axis]} is {1e3 * at[j]:.4g} mm; a tip of "
                f"{1e3 * program.radius_m[j]:.3g} mm needs {1e3 * program.radius_m[j]:.3g} to "
                f"{1e3 * (body.size_m[axis] - program.radius_m[j]):.4g} mm to stand on the block."
            )


def _plant(
    bench: Bench,
    name: str,
    size: float,
    rng: np.random.Generator,
    others: tuple[Planted, ...],
    given: dict[str, float],
) -> tuple[Planted, float]:
    effect = HIDDEN[name]
    drawn = effect.draw(bench, rng)
    sign = float(rng.choice([-1, 1])) if effect.two_sided else 1.0
    known = {*drawn, effect.amplitude}
    drawn |= {key: value for key, value in given.items() if key in known}
    if effect.amplitude not in drawn:
        return amplitude_for(bench, effect, drawn, size, others, sign)
    without = press(bench, (*others, (effect, {**drawn, effect.amplitude: 0.0})))
    return (effect, drawn), size_of(press(bench, (*others, (effect, drawn))), without)


def _map_from(record: Mapping[str, Any]) -> TruthMap:
    inclusions = (
        Inclusion(i["weight_pa"], (i["x_m"], i["y_m"], i["z_m"]), i["radius_m"])
        for i in record["inclusions"]
    )
    return TruthMap(record["background_pa"], tuple(inclusions))
