"""`palpmap blind`: a scan with something hidden in it, whose answer is sealed."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import JsonValue

from models import InputError, write_scan
from palpmap.blind.layout import RADII_M, Layout, usual_layout, varied_layout
from palpmap.blind.records import TrialTruthRecord
from palpmap.blind.robot_trial import robot_scan
from palpmap.blind.seal import FOLDER, seal
from palpmap.console import Output, to_type
from palpmap.run_folder import RunFolder
from palpmap.study.study import About, Body, Map, Probe, Study, write_study
from palpmap.study.truth_file import Truth

if TYPE_CHECKING:
    from sim.body import TruthMap

SIZES = (0.01, 0.10)
SMALLEST_OUTSIDER = 0.03  # below it, to call the residual noise can be the right answer
KINDS = {"none": 0.15, "single": 0.55, "pair": 0.15, "outsider": 0.15}
"""A candidate for hiding, with its probability."""

WORDS = ("none", "single", "pair", "outsider", "structured", "compliance", "form")
ALIKE = frozenset({"finite_strain", "strain_stiffening"})
MOST_FORCE = 3.0  # of the scan's largest: what the laboratory may press with in a further scan


@dataclass(frozen=True)
class Conditions:
    """Conditions under which trials are drawn.

    Attributes
    ----------
    effects : what may be hidden, one of them: names of effects, or words of `WORDS`; empty for
        anything
    size : share of the signal, None to draw 1 to 10 %
    radii : 1 or 2 tip radii
    mixed : places in random order with two forces and a rest, or row by row with one force
    small : a smaller block, with fewer presses
    robot : the virtual robot presses, with the effect in its loop; else finished readings change
    varied : body, tip and presses of any size, see `palpmap.blind.layout.varied_layout`
    """

    effects: tuple[str, ...] = ()
    size: float | None = None
    radii: int = 1
    mixed: bool = True
    small: bool = False
    robot: bool = False
    varied: bool = False

    def settings(self) -> dict[str, JsonValue]:
        """Return the conditions as a run folder keeps them."""
        return {**asdict(self), "effects": list(self.effects)}


@dataclass(frozen=True)
class Trial:
    """The draw for a trial.

    Attributes
    ----------
    seed : of everything in it
    effects, sizes : names and shares of the signal
    radii : number of tip radii
    mixed : whether the places come in random order, every other one pressed three times as hard,
        with an early rest
    small : whether the block is two thirds as large, with 36 presses and cells of the same size
    robot : whether the virtual robot presses
    varied : whether body, tip and presses are drawn, too
    """

    seed: int
    effects: tuple[str, ...]
    sizes: tuple[float, ...]
    radii: int
    mixed: bool = True
    small: bool = False
    robot: bool = False
    varied: bool = False


def run_blind(conditions: Conditions, *, out: Path | None, seed: int, output: Output) -> bool:
    """Make a blind trial: scan.csv, study.toml and the sealed answer."""
    if out is not None and (out / FOLDER).exists():
        raise InputError(
            f"{out}: holds a blind trial already, with its answer and perhaps results; choose "
            "another --out"
        )
    trial = draw_trial(seed, conditions)
    with (
        RunFolder("blind", out, seed=seed, settings=conditions.settings()) as run,
        output.task() as task,
    ):
        task.say("hiding an effect and pressing")
        presses = make_trial(run.path, trial)
    study, radii = run.path / "study.toml", conditions.radii
    output.result(
        {"schema": 1, "run": str(run.path), "presses": presses, "seed": seed},
        f"{presses} presses with {radii} tip radi{'i' if radii > 1 else 'us'}; something may be "
        "hidden in them.",
        f"Next: {to_type('explain', study, '--out', run.path / 'explained')}",
        f"Then: {to_type('reveal', run.path)}",
    )
    return True


def draw_trial(seed: int, conditions: Conditions) -> Trial:
    """Draw the hidden effects of a trial.

    Raises
    ------
    InputError
        An unknown name, a size or a number of radii that make no sense.
    """
    effects, size, radii = conditions.effects, conditions.size, conditions.radii
    if radii not in RADII_M:
        raise InputError(f"found {radii} tip radii, expected 1 or 2")
    if size is not None and not 0 < size <= 0.5:
        raise InputError(f"found a size of {size:g}, expected more than 0 and at most 0.5")
    if conditions.varied and (conditions.small or conditions.robot):
        raise InputError(
            "found --varied with --small or --robot, expected it alone: the block is drawn, and "
            "pressed without the robot"
        )
    rng = np.random.default_rng([seed, 11])
    kinds = list(KINDS)
    weights = list(KINDS.values())
    word = str(rng.choice(effects)) if effects else str(rng.choice(kinds, p=weights))
    names = _draw_effects(word, rng)
    low = [SMALLEST_OUTSIDER if name.startswith("outside_") else SIZES[0] for name in names]
    sizes = [size or float(np.exp(rng.uniform(np.log(a), np.log(SIZES[1])))) for a in low]
    kind = {name: getattr(conditions, name) for name in ("mixed", "small", "robot", "varied")}
    return Trial(seed, names, tuple(sizes), radii, **kind)


def _draw_effects(word: str, rng: np.random.Generator) -> tuple[str, ...]:
    from sim.planted import FORMS, HIDDEN, INSIDERS, OUTSIDERS

    if "+" in word:
        return tuple(HIDDEN[name].name for name in word.split("+"))
    if word not in WORDS:
        return (HIDDEN[word].name,)
    if word == "none":
        return ()
    structured = [e.name for e in HIDDEN if e.category == "structured"]
    if word == "pair":
        while True:
            first, second = (str(name) for name in rng.choice(structured, 2, replace=False))
            if not {first, second} <= ALIKE and second not in _other_forms(first):
                return first, second
    choice = {
        "single": INSIDERS,
        "outsider": OUTSIDERS,
        "form": FORMS,
        "structured": structured,
        "compliance": [e.name for e in HIDDEN if e.category == "compliance"],
    }[word]
    return (str(rng.choice(choice)),)


def _other_forms(name: str) -> tuple[str, ...]:
    """Names of the other effects of a family of the catalogue; none for an outsider."""
    from identify.catalogue import CATALOGUE

    family = next((effect.family for effect in CATALOGUE if effect.name == name), None)
    return tuple(e.name for e in CATALOGUE if e.family == family and e.name != name)


def make_trial(
    folder: Path, trial: Trial, per_side: int | None = None, truth: "TruthMap | None" = None
) -> int:
    """Make a trial's scan, study and sealed answer in a folder; return the number of presses.

    Parameters
    ----------
    per_side, truth : of a trial that is not varied, see `palpmap.blind.layout.usual_layout`
    """
    from sim.bench import planted_scan
    from sim.planted import HIDDEN

    layout = varied_layout(trial) if trial.varied else usual_layout(trial, per_side, truth)
    study = _study(folder, trial, layout)
    if trial.robot:
        plant = tuple(zip(trial.effects, trial.sizes, strict=True))
        scan, study, said = robot_scan(
            study, layout.program, Truth(layout.truth), trial.seed, plant
        )
        said["size_m"] = layout.size_m
    else:
        scan, said = planted_scan(
            trial.effects, trial.sizes, trial.seed, layout.radii_m, layout.truth, layout.program,
            **layout.options,
        )  # fmt: skip
    for effect in said["effects"]:
        effect["kin"] = HIDDEN[effect["name"]].kin or _other_forms(effect["name"])
    answer = TrialTruthRecord.model_validate(said)
    if not trial.robot:
        study = study.model_copy(update={"noise": answer.noise})
    write_scan(scan, folder / "scan.csv")
    write_study(study, folder / "study.toml")
    seal(folder, answer)
    return len(scan.press_ids)


def _study(folder: Path, trial: Trial, layout: Layout) -> Study:
    """Return what the experimenter knows beforehand: block, tip, one inclusion."""
    return Study(
        study=About(name=f"blind trial {trial.seed}", scan=(folder / "scan.csv").resolve()),  # pyright: ignore[reportCallIssue]
        body=Body(
            shape="block",
            size_m=layout.size_m,
            poisson_ratio=layout.poisson_ratio,
            cell_size_m=layout.cell_m,
        ),  # pyright: ignore[reportCallIssue]
        probe=Probe(
            tip="flat",
            radius_m=layout.radii_m[0],
            most_force_n=MOST_FORCE * float(layout.program.force_n.max()),
        ),
        map=Map(inclusions=1),
    )
