"""The `palpmap` command."""

from typing import Annotated

import typer
import typer.core

from palpmap import __version__
from palpmap.cli.add import add, history
from palpmap.cli.blind import blind, press, reveal
from palpmap.cli.check import check
from palpmap.cli.check_effect import check_effect
from palpmap.cli.check_rig import check_rig
from palpmap.cli.compare import compare, predict
from palpmap.cli.demo import demo
from palpmap.cli.diagnose import diagnose
from palpmap.cli.effects import effects
from palpmap.cli.explain import explain
from palpmap.cli.export import export
from palpmap.cli.fit import fit
from palpmap.cli.import_ import import_
from palpmap.cli.join import join
from palpmap.cli.limits import limits
from palpmap.cli.new import new
from palpmap.cli.paper import paper
from palpmap.cli.review import review
from palpmap.cli.scan import scan
from palpmap.console import answers


class _Commands(typer.core.TyperGroup):
    """All commands; faults of an option's value are said in the words of a study's faults."""

    def invoke(self, ctx) -> object:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            faults = getattr(error.__cause__, "errors", None)  # of pydantic, by which typer reads
            if faults is not None:
                from models import shortened
                from palpmap.study.faults import expected_by

                fault = faults()[0]
                error.message = f"found {shortened(fault['input'])}, expected {expected_by(fault)}"
            raise


app = typer.Typer(
    name="palpmap",
    cls=_Commands,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # boxes around the help would cost a third of its time
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["--help", "-h"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"palpmap {__version__}")
        raise typer.Exit


@app.callback()
def palpmap(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Say the version."),
    ] = False,
) -> None:
    """Stiffness maps of soft bodies from robotic palpation: scan, identify, compare, replay.

    Example: palpmap demo
    """


_COMMANDS = (
    demo,
    paper,
    scan,
    fit,
    compare,
    predict,
    diagnose,
    add,
    history,
    limits,
    explain,
    effects,
    check_effect,
    blind,
    press,
    reveal,
    review,
    check,
    join,
    import_,
    export,
    new,
    check_rig,
)
for _command in _COMMANDS:
    name = _command.__name__.rstrip("_").replace("_", "-")  # import is Python's own word
    app.command(name)(answers(_command))


def main() -> None:
    """Run the command line; exit codes: 0 done, 1 a criterion failed, 2 bad input."""
    app(prog_name="palpmap")


if __name__ == "__main__":
    main()
