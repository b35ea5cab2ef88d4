"""The demo as a user runs it: what it prints, and the README's two pictures of it.

Part of `python benchmarks/run.py`. The picture of the recording needs a Vulkan driver; without one
the old picture stays.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).parent.parent / "docs"
RUN = "runs/demo"


def table() -> list[str]:
    """Return what the demo prints, as a block of text; replace the pictures."""
    path = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "COLUMNS": "80"}
    with tempfile.TemporaryDirectory() as folder:

        def palpmap(*words: str) -> subprocess.CompletedProcess[str]:
            return subprocess.run(
                [sys.executable, "-m", "palpmap", *words],
                cwd=folder,
                env=environment,
                stdout=subprocess.PIPE,
                text=True,
                check=False,
            )

        said = palpmap("demo", "--out", RUN).stdout
        run = Path(folder, RUN)
        Image.open(run / "figures" / "map.png").save(DOCS / "demo.png", optimize=True)
        if palpmap("review", RUN, "--png").returncode == 0:
            picture = Image.open(run / "recording.png").convert("RGB")
            # A quarter of the bytes; with k-means pale red and blue stay apart from yellow
            few_colours = picture.quantize(256, kmeans=1, dither=Image.Dither.NONE)
            few_colours.save(DOCS / "recording.png", optimize=True)
    return ["```text", *(line.rstrip() for line in said.strip().splitlines()), "```"]
