"""`palpmap blind --tournament N`: many blind trials, each made, explained and judged.

`trials.jsonl` in the run folder gets one line a finished trial, as it finishes: what was hidden,
what was found, the judgement. A tournament that was stopped goes on from there with the same
`--out`.
"""

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context, parent_process
from pathlib import Path
from threading import Thread

import numpy as np
from pydantic import JsonValue

from models import InputError, read_program, replaced
from palpmap.blind.further_presses import press_further
from palpmap.blind.records import AnswerRecord, AtFirstRecord, TrialLine
from palpmap.blind.score import map_errors, score_blind
from palpmap.blind.seal import unseal
from palpmap.blind.statistics import tally, tournament_record, tournament_screen
from palpmap.blind.trial import Conditions, Trial, draw_trial, make_trial
from palpmap.console import Output
from palpmap.progress import counted
from palpmap.run_folder import RunFolder

FILE = "trials.jsonl"
NONE_SHARE = 0.1
PAIR_SHARE = 0.1

Explain = Callable[[Path, Path, int], AnswerRecord]
"""From a study, a new folder and a seed to the result of result.json."""


@dataclass(frozen=True)
class Game:
    """One trial of a tournament: its number, where it is played, and the draw for it.

    `further` is how often proposed presses are made and explained if the answer is ambiguous.
    """

    number: int
    folder: str
    trial: Trial
    further: int = 0


def run_tournament(
    conditions: Conditions,
    *,
    count: int,
    further: int,
    workers: int | None,
    dask: str | None,
    out: Path | None,
    seed: int,
    output: Output,
) -> bool:
    """Play a tournament; see the module.

    Parameters
    ----------
    count : number of trials
    conditions : of the trials; without effects all take turns
    further : how often the presses that an ambiguous answer proposes are made and explained too
    workers : processes, None for one a core
    dask : address of a dask scheduler that plays instead
    """
    settings = {**conditions.settings(), "further": further, "seed": seed}
    with RunFolder("tournament", out, seed=seed, settings=settings) as run:
        done = earlier_games(run.path, settings)
        drawn = draw_games(run.path, count, conditions, seed, further)
        games = [game for game in drawn if game.number not in done]
        stages = counted("playing", len(games))
        with output.task(stages) as task, (run / FILE).open("a", encoding="utf-8") as file:
            task.say("playing")
            players = workers or os.cpu_count() or 1
            played = play_dask(games, dask) if dask else play_here(games, players)
            for line in played:
                done[line.number] = line
                file.write(line.to_json() + "\n")
                file.flush()
                task.say(f"{len(done)} of {count} played, {tally(list(done.values()))}")
        lines = [done[number] for number in sorted(done) if number < count]
        record = tournament_record(lines)
        record.write(run / "tournament.json")
        output.result({**record.to_dict(), "run": str(run.path)}, *tournament_screen(record))
    return record.wrong == 0 and record.failed == 0


def draw_games(
    run: Path, count: int, conditions: Conditions, seed: int, further: int = 0
) -> list[Game]:
    """Draw the trials; without a choice of effects, all that can be hidden take turns."""
    from sim.planted import INSIDERS, OUTSIDERS

    words = list(conditions.effects)
    if not words:
        singles = [*INSIDERS, *OUTSIDERS]
        words = singles + ["none"] * max(round(NONE_SHARE * len(singles)), 1)
        words += ["pair"] * max(round(PAIR_SHARE * len(singles)), 1)
    turns: list[str] = []
    rng = np.random.default_rng([seed, 13])
    while len(turns) < count:
        turns += [words[i] for i in rng.permutation(len(words))]
    return [
        Game(
            number,
            str(run / "trials" / f"{number:04d}"),
            draw_trial(1_000_000 * seed + number, replace(conditions, effects=(turns[number],))),
            further,
        )
        for number in range(count)
    ]


def earlier_games(run: Path, settings: Mapping[str, JsonValue]) -> dict[int, TrialLine]:
    """Lines of the trials that were played before, by number; a line cut off is dropped.

    Raises
    ------
    InputError
        They were played with other settings.
    """
    path = run / FILE
    head = run / "settings.json"
    # Of tournaments whose settings do not say
    usual = {"mixed": False, "further": 0, "small": False, "robot": False, "varied": False}
    if head.is_file():
        try:
            before = {**usual, **json.loads(head.read_text(encoding="utf-8"))}
        except ValueError as error:
            raise InputError(
                f"{head}: found text that is not JSON ({error}); choose another --out"
            ) from error
        if before != {**usual, **settings}:
            raise InputError(
                f"{run}: the tournament there was begun with {before}, now asked for with "
                f"{settings}; take the same settings (mixed: not --plain) or another --out"
            )
    else:
        head.write_text(json.dumps(settings) + "\n", encoding="utf-8")
    if not path.is_file():
        return {}
    done: dict[int, TrialLine] = {}
    kept: dict[int, str] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            game = TrialLine.model_validate_json(line)
        except ValueError:
            continue
        done[game.number], kept[game.number] = game, line
    whole = "".join(f"{line}\n" for line in kept.values())
    with replaced(path) as beside:
        beside.write_text(whole, encoding="utf-8")
    return done


def play_here(games: Sequence[Game], players: int) -> Iterator[TrialLine]:
    """Play on this machine's cores; yields each line as its trial ends.

    Workers start anew (no fork: the parent has threads), one thread each, and end with their
    trial: what it held in memory, gigabytes with two tips, is then free for the next.

    Raises
    ------
    InputError
        A worker was killed from outside.
    """
    if not games:
        return
    single = {name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}
    before = {name: os.environ.get(name) for name in single}
    os.environ.update(single)
    pool = ProcessPoolExecutor(
        min(players, len(games)),
        get_context("spawn"),
        initializer=_end_with_parent,
        max_tasks_per_child=1,
    )
    try:
        waiting = [pool.submit(play, game) for game in games]
        for future in as_completed(waiting):
            yield future.result()
    except BrokenProcessPool as error:
        raise InputError(
            "a process of the tournament was killed, as happens when memory runs out: give the "
            "same command again to go on, with fewer --workers if need be (up to 5 GB each)"
        ) from error
    finally:
        workers = list((pool._processes or {}).values())
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in workers:  # a trial under way is not worth waiting for after Ctrl-C
            worker.terminate()
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _end_with_parent() -> None:
    """End this worker when the process that started it is gone, killed perhaps."""
    parent = parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    Thread(target=wait, daemon=True).start()


def play_dask(games: Sequence[Game], address: str) -> Iterator[TrialLine]:
    """Play on a dask cluster whose workers have palpmap and see the run folder."""
    try:
        from dask.distributed import Client, as_completed  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise InputError(
            "--dask needs dask.distributed, which is not installed: pip install 'palpmap[dask]'"
        ) from error
    try:
        client = Client(address)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--dask {address}: no scheduler answers there, expected an address as "
            f"`dask scheduler` prints it, like tcp://host:8786 ({error})"
        ) from error
    with client:
        playing = {client.submit(play, game, pure=False): game for game in games}
        for future in as_completed(playing):
            error = future.exception()  # a worker was lost, or the folder cannot be made
            yield _failed(_begun(playing[future]), error) if error else future.result()


def _begun(game: Game) -> TrialLine:
    return TrialLine(number=game.number, trial=asdict(game.trial), hidden=game.trial.effects)


def _failed(line: TrialLine, error: BaseException) -> TrialLine:
    return line.changed(error=f"{type(error).__name__}: {error}")


def play(game: Game, explain: Explain | None = None, per_side: int | None = None) -> TrialLine:
    """Make, explain and judge one trial; a fault of the loop is a line too, not an end of it all.

    Parameters
    ----------
    explain : the loop to be judged, that of `palpmap explain` if None
    per_side : presses along each edge, see `make_trial`
    """
    from sim.body import forget_models

    folder = Path(game.folder)
    folder.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    line = _begun(game)
    try:
        # Further presses of the same trial, begun here before and stopped
        for stale in (*folder.glob("study_[0-9]*.toml"), *folder.glob("scan_[0-9]*.csv")):
            stale.unlink()
        make_trial(folder, game.trial, per_side)
        forget_models()  # the search needs the memory
        made = time.perf_counter()
        explain = explain or explain_trial
        result = explain(folder / "study.toml", folder, game.trial.seed)
        for _ in range(game.further):
            asked = [p.program for p in result.next_presses]
            if result.verdict != "ambiguous" or not asked:
                break
            presses = read_program(folder / asked[0])
            line = line.changed(
                at_first=line.at_first or AtFirstRecord.copy_of(result),
                further_presses=(line.further_presses or 0) + len(presses),
            )
            result = explain(press_further(folder, presses), folder, game.trial.seed)
        truth = unseal(folder)
        return line.changed(
            sizes=tuple(effect.size for effect in truth.effects),
            map=map_errors(result, truth),
            made_s=made - started,
            explained_s=time.perf_counter() - made,
            **dict(AtFirstRecord.copy_of(result)),
            **dict(score_blind(result, truth.effects)),
        )
    except Exception as error:  # a trial that fails is counted, the others go on
        return _failed(line, error)


def explain_trial(study: Path, out: Path, seed: int) -> AnswerRecord:
    """Run the loop of `palpmap explain` on a study, without report and recording."""
    from palpmap import api
    from palpmap.experiment import read_study
    from palpmap.result.next_scan import Sites, write_programs

    why = api.explain(read_study(study), seed=seed)
    write_programs(why.assessment, Sites.of(why.experiment.scan, why.experiment.study), out)
    why.record.write(out / "result.json")
    return AnswerRecord.read(out / "result.json")
