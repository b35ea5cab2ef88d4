"""The documentation site: it builds without a warning, and is read without a network."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import palpmap
from identify.catalogue.catalogue import CATALOGUE

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> dict[str, str]:
    """Return the pages of the site, by path."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return {
        page.relative_to(folder).as_posix(): page.read_text(encoding="utf-8")
        for page in folder.rglob("*.html")
    }


def test_each_effect_has_a_page_with_its_formula_drawn(site):
    for effect in CATALOGUE:
        page = site[f"effects/{effect.name}.html"]
        assert page.count("<math") == 1, effect.name
        assert "\\" not in re.findall(r"<math.*?</math>", page, re.DOTALL)[0], effect.name
        for parameter in effect.parameters:
            assert f"<code>{parameter.name}</code>" in page
        assert f'href="{effect.name}.html"' in site["effects/index.html"]


def test_the_reference_has_every_name_of_the_python_door(site):
    written = set(re.findall(r"(?m)^::: palpmap\.(\w+)$", (ROOT / "docs/python.md").read_text()))
    assert written == set(palpmap.__all__) - {"__version__"}


def test_nothing_is_fetched_from_a_network(site):
    for path, page in site.items():
        sources = re.findall(
            r"<(?:link|script|img|iframe)\b[^>]*(?:src|href)=[\"']?([^\"' >]+)", page
        )
        assert [source for source in sources if "//" in source] == [], path
        assert "fonts.googleapis" not in page
