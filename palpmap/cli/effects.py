"""`palpmap effects`."""

from typing import Annotated

import typer

from palpmap.cli.options import Json, Quiet
from palpmap.console import Output


def effects(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME",
            help="An effect, or a file (.py) with one's own, whose code is executed.",
            show_default=False,
        ),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """List the effects that a model may lack.

    With a name, the page of one of them.

    Example: palpmap effects viscoelasticity
    """
    from rich.markdown import Markdown

    from identify.catalogue import CATALOGUE, load_effect
    from palpmap.commands.effects import catalogue_table, effect_page, effect_record

    output = Output(quiet=quiet, json=json)
    if name is None:
        records = [effect_record(effect) for effect in CATALOGUE]
        output.result({"effects": records}, catalogue_table(CATALOGUE))
        output.say("More on one of them: palpmap effects NAME")
    else:
        effect = load_effect(name) if name.endswith(".py") else CATALOGUE[name]
        output.result(effect_record(effect), Markdown(effect_page(effect)))
