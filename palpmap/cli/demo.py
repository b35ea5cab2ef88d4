"""`palpmap demo`."""

from palpmap.cli.options import Json, Out, PaperForce, Quiet, Seed
from palpmap.console import Output


def demo(
    out: Out = None,
    seed: Seed = 2,
    paper_force: PaperForce = False,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Scan a virtual phantom, find its map, compare.

    The found map is compared with the true one; recording and report are in the run folder.

    Example: palpmap demo --out runs/first
    """
    from palpmap.commands.demo import run_demo

    return run_demo(
        out=out, seed=seed, paper_force=paper_force, output=Output(quiet=quiet, json=json)
    )
