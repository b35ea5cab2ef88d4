"""`palpmap demo`."""

from palpmap.cli.options import Json, Out, PaperForce, Quiet, Seed
from palpmap.console import Output


def demo(
    out: Out = None,
    seed: Seed = 0,
    paper_force: PaperForce = False,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Scan a soft body in the virtual laboratory, find its map and compare it with the truth.

    Example: palpmap demo --out runs/first
    """
    from palpmap.demo import run_demo

    return run_demo(
        out=out, seed=seed, paper_force=paper_force, output=Output(quiet=quiet, json=json)
    )
