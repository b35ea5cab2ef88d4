"""Prose of the five packages: the noun first, in the words of the field.

`python tests/test_prose.py [package ...]` lists the offending sentences with file and line.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("models", "fem", "sim", "identify", "palpmap")
MOST_RELATIVE = 0.03
"""Share of a package's sentences that may hang on a relative word."""
RELATIVE = re.compile(r"\b(what|whether)\b", re.IGNORECASE)
"""Words that open a clause in place of a noun, counted in first paragraphs of docstrings."""
HOUSE_WORDS = {
    r"rungs?": "step",
    r"rivals?": "candidates",
    r"(what|that) (is|was) left|what remains|left of": "residual, remainder",
    r"tell(s|ing)? apart|told (apart|from)": "separate, distinguish",
    r"(borne|bears?|bearing) out": "confirm, support",
    r"stand(s|ing)? out": "outlying",
    r"as (it|they) stands?": "unchanged",
    r"by (itself|themselves)": "alone",
    r"all but": "almost, except",
    r"next of kin": "nearest candidate",
    r"pass(es)? for": "is mistaken for",
    r"pays? for": "justify",
}
"""Idioms and words of the house with the field's words, counted in docstrings and comments."""
HOUSE = re.compile(rf"\b({'|'.join(HOUSE_WORDS)})\b", re.IGNORECASE)
SENTENCE_END = re.compile(r"(?<=[.;:?!])\s+")


def docstrings(source: str) -> Iterator[tuple[int, str]]:
    """Docstrings of modules, classes, functions and attributes, each with its line."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            for statement in node.body:
                if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                    yield statement.lineno, str(statement.value.value)


def comments(source: str) -> Iterator[tuple[int, str]]:
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def first_sentences(docstring: str) -> list[str]:
    """Sentences of the first paragraph."""
    return SENTENCE_END.split(" ".join(docstring.strip().split("\n\n")[0].split()))


@cache
def offenders(package: str, root: Path = ROOT) -> tuple[int, list[str], list[str]]:
    """Return the number of first sentences, those with a relative word, and all house words."""
    total, relative, house = 0, [], []
    for path in sorted((root / package).rglob("*.py")):
        source, name = path.read_text(encoding="utf-8"), path.relative_to(root)
        own = list(docstrings(source))
        for line, text in own:
            sentences = first_sentences(text)
            total += len(sentences)
            relative += [f"{name}:{line}: {s}" for s in sentences if RELATIVE.search(s)]
        for line, text in (*own, *comments(source)):
            for found in HOUSE.finditer(" ".join(text.split())):
                place = f"{found.string[max(found.start() - 30, 0) : found.end() + 20]}"
                house.append(f"{name}:{line}: {found[0]!r} in '...{place}...'")
    return total, relative, house


@pytest.mark.parametrize("package", PACKAGES)
def test_sentences_start_from_a_noun(package: str) -> None:
    total, relative, _ = offenders(package)
    most = MOST_RELATIVE * total
    assert len(relative) <= most, "\n".join([f"at most {most:.0f} of {total}:", *relative])


@pytest.mark.parametrize("package", PACKAGES)
def test_words_are_the_fields(package: str) -> None:
    _, _, house = offenders(package)
    assert not house, "\n".join(house)


def test_an_offender_is_found(tmp_path: Path) -> None:
    (tmp_path / "ours").mkdir()
    (tmp_path / "ours" / "module.py").write_text(
        '"""Tells whether it fits. It fits.\n\nNo what in the rest."""\n# the rival here\n'
    )
    total, relative, house = offenders("ours", tmp_path)
    assert total == 2
    assert relative == ["ours/module.py:1: Tells whether it fits."]
    assert [entry.split(":")[:2] for entry in house] == [["ours/module.py", "4"]]


if __name__ == "__main__":
    for package in sys.argv[1:] or PACKAGES:
        total, relative, house = offenders(package)
        print(*relative, *house, sep="\n")
        print(f"{package}: {len(relative)} of {total} sentences ({len(relative) / total:.1%})")
        print(f"{package}: {len(house)} house words")
