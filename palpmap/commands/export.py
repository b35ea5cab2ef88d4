"""`palpmap export`: a run's map for another program."""

from pathlib import Path

from palpmap import api
from palpmap.console import Output
from palpmap.export import export_run


def run_export(*, run: Path, form: str, out: Path | None, output: Output) -> None:
    """Write the map of a run folder.

    Raises
    ------
    InputError
        See `palpmap.export.export.export_run`.
    """
    from rich.markup import escape

    with output.task() as task:
        task.say("meshing the body")
        path, said = export_run(api.read_run(run), form, out)
    output.result(
        {"schema": 1, "file": str(path), "said": said},
        *(f"- {escape(sentence)}" for sentence in said),
        f"Written: {escape(str(path))}",
    )
