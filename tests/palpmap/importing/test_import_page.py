"""The page on import: its commands run in the order in which it gives them, to a checked study."""

import re
import shlex
from pathlib import Path

from typer.testing import CliRunner

from models.scan_file import read_scan
from palpmap.__main__ import app
from tests.palpmap.importing import raw_scan
from tests.paths import LAB, ROOT

PAGE = (ROOT / "docs" / "import.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def follow(presses: int, last: str) -> None:
    """Do in the current folder as the page says, down to a command."""
    scan = read_scan(LAB / "case_c" / "scan.csv")
    raw_scan.write_mcap(scan.rows(scan.press < presses), Path("session_1"))
    lines = "".join(blocks("sh")).splitlines()
    for line in lines[: [shlex.split(line)[1] for line in lines].index(last) + 1]:
        command, _, target = line.partition(" > ")
        result = CliRunner().invoke(app, shlex.split(command)[1:])
        assert result.exit_code == 0, result.output
        if target:
            text = result.stdout
            for shown in blocks("text")[0].splitlines():
                assert shown in text, shown
            Path(target).write_text(text[: text.index("[probe]")] + blocks("toml")[0])


def test_the_page_leads_from_a_bag_to_a_checked_study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    follow(12, "check")
    assert "12 presses were cut" in Path("study/import.md").read_text()
