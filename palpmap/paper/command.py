"""`palpmap paper`: run the paper's six tests, print the findings, leave figures and numbers."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from pydantic import Field

from identify.optimize import OPTIMIZERS
from models import InputError
from palpmap.paper.identical_twin import (
    LARGEST_RELATIVE_ERROR,
    PaperResult,
    PaperTest,
    paper_tests,
    solve_tests,
    symbol,
)
from palpmap.progress import counted
from palpmap.record import FileRecord, Record

if TYPE_CHECKING:
    from rich.table import Table

    from palpmap.console import Output


def run_paper(
    *,
    optimizer: str,
    tests: Sequence[str] | None,
    out: str | os.PathLike[str] | None,
    output: Output,
) -> bool:
    """Run the tests, all or by name, and leave figures and numbers in a run folder.

    Returns whether every parameter was found within `LARGEST_RELATIVE_ERROR`.
    """
    from palpmap.run_folder import RunFolder

    chosen = _chosen(paper_tests(), tests)
    settings = {"optimizer": optimizer, "tests": [test.name for test in chosen]}
    with RunFolder("paper", out, settings=settings) as run:
        with output.task(counted("the paper's tests", len(chosen))) as task:
            task.say("the paper's tests")
            results = solve_tests(chosen, OPTIMIZERS[optimizer], task.advance)
        record = paper_record(results, optimizer)
        record.write(run / "paper.json")
        # Only now: drawing beside the solvers would hold up the interpreter that they share
        from palpmap.paper.figures import draw_figures

        drawn = draw_figures(results, run / "figures")
        passed = all(result.passed for result in results)
        verdict = "every" if passed else "NOT every"
        output.result(
            record.to_dict(),
            paper_table(results, optimizer),
            f"\n{verdict} parameter within {LARGEST_RELATIVE_ERROR:g} of the correct one; an "
            "identical twin proves the optimiser, not the physics\n"
            f"{len(drawn)} figures in {run / 'figures'}",
        )
        run.finish("done" if passed else "done, a criterion failed")
    return passed


class SoughtRecord(Record):
    """A parameter that a test sought."""

    unit: str
    initial: float
    correct: float
    found: float
    relative_error: float = Field(description="|found / correct - 1|")


class PaperTestRecord(Record):
    """How one of the paper's tests ended."""

    parameters: Mapping[str, SoughtRecord] = Field(description="by the paper's names")
    evaluations: int = Field(description="of misfit and gradient")
    seconds: float = Field(description="time of the search, s")
    passed: bool


class PaperRecord(FileRecord):
    """paper.json: the paper's tests by one optimiser."""

    optimizer: str
    tests: Mapping[str, PaperTestRecord] = Field(description="by name")


def paper_record(results: Sequence[PaperResult], optimizer: str) -> PaperRecord:
    """Return the numbers of the tests."""
    tests = {}
    for result in results:
        columns = zip(
            result.test.theta,
            result.path[0],
            result.values(result.test.correct),
            result.path[-1],
            result.relative_error,
            strict=True,
        )
        tests[result.test.name] = PaperTestRecord(
            parameters={
                theta: SoughtRecord(
                    unit=symbol(theta).unit,
                    initial=initial,
                    correct=correct,
                    found=found,
                    relative_error=error,
                )
                for theta, initial, correct, found, error in columns
            },
            evaluations=result.evaluations,
            seconds=round(result.seconds, 3),
            passed=result.passed,
        )
    return PaperRecord(optimizer=optimizer, tests=tests)


def paper_table(results: Sequence[PaperResult], optimizer: str) -> Table:
    """Lay the results out as a table."""
    from rich.table import Table

    table = Table(title=f"The paper's tests by {optimizer}, identical twin")
    table.add_column("test")
    table.add_column("sought", no_wrap=True)
    for heading in ("initial", "correct", "found", "error", "evals", "s"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.caption = "error: relative; evals: evaluations of misfit and gradient"
    for result in results:
        correct = result.values(result.test.correct)
        for i, theta in enumerate(result.test.theta):
            first = i == 0
            table.add_row(
                result.test.name if first else "",
                f"{theta} {symbol(theta).unit}",
                f"{result.path[0, i]:g}",
                f"{correct[i]:g}",
                f"{result.path[-1, i]:.8g}",
                f"{result.relative_error[i]:.1e}",
                str(result.evaluations) if first else "",
                f"{result.seconds:.1f}" if first else "",
                end_section=i == len(result.test.theta) - 1,
            )
    return table


def _chosen(tests: Sequence[PaperTest], names: Sequence[str] | None) -> list[PaperTest]:
    """Pick tests by name, or all."""
    known = {test.name: test for test in tests}
    for name in names or ():
        if name not in known:
            raise InputError(f"--test {name}: no such test; there are {', '.join(known)}")
    return [known[name] for name in names] if names else list(tests)
