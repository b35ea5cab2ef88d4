"""The notebooks of `examples/` run from a clean clone, and are stored with their pictures."""

import os

import nbformat
import pytest
from nbclient import NotebookClient

from tests.paths import ROOT

LARGEST_BYTES = 200_000


@pytest.mark.parametrize(
    "name",
    [pytest.param("fit_and_compare", marks=pytest.mark.slow), "find_the_missing_effect"],
)
def test_a_notebook_runs_and_is_stored_with_its_pictures(name, monkeypatch):
    path = ROOT / "examples" / f"{name}.ipynb"
    stored = nbformat.read(path, as_version=4)
    assert sum(pictures(cell) for cell in stored.cells) >= 2
    assert path.stat().st_size < LARGEST_BYTES
    monkeypatch.setenv("PYTHONPATH", os.fspath(ROOT))
    client = NotebookClient(stored, timeout=600, resources={"metadata": {"path": path.parent}})
    done = client.execute()
    assert sum(pictures(cell) for cell in done.cells) >= 2


def pictures(cell) -> int:
    """Number of pictures among a cell's outputs, those within HTML included."""
    shown = [output.get("data", {}) for output in cell.get("outputs", ())]
    return sum("image/png" in data or "image/png" in data.get("text/html", "") for data in shown)
