"""Where the tests' data and the project lie."""

from pathlib import Path

TESTS = Path(__file__).parent
ROOT = TESTS.parent
LAB = TESTS / "data" / "lab"
"""Scans of an independent laboratory, with their truths."""
TWELVE = TESTS / "data" / "twelve_presses"
"""A small study with its scan and its fit."""
