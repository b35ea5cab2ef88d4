"""The report fits its page at the width of a screen and of a telephone, in a real browser."""

import re
import shutil
import subprocess

import pytest

from palpmap.report.fit_report import write_report
from tests.palpmap.report.test_report_files import load_finding, make_run

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
MEASURE = """<script>
addEventListener("load", () => {
  const wide = [...document.querySelectorAll(".wide, section, figure, p, li")]
    .filter(box => box.scrollWidth > box.clientWidth + 1)
    .map(box => box.textContent.trim().slice(0, 40));
  if (document.documentElement.scrollWidth > innerWidth) wide.push("the page");
  document.title = `measured ${innerWidth}: ${wide.join(" | ")}`;
});
</script>"""


def too_wide(page, width, folder):
    """What of a page is wider than its place, in the first browser that is installed."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip("no headless browser is installed (chromium or chrome)")
    file = folder / "measured.html"
    file.write_text(page.replace("</body>", f"{MEASURE}</body>"), encoding="utf-8")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom",
               f"--user-data-dir={folder / 'profile'}", f"--window-size={width},2000",
               file.as_uri()]  # fmt: skip
    dom = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    (shown, says) = re.search(r"<title>measured (\d+): (.*?)</title>", dom, re.DOTALL).groups()
    assert int(shown) == width
    return says


@pytest.mark.parametrize("width", [1400, 500])
def test_the_report_of_an_explanation_fits(explained_case, tmp_path, width):
    page = (explained_case.folder / "report.html").read_text(encoding="utf-8")
    assert not too_wide(page, width, tmp_path)


@pytest.mark.parametrize("width", [1400, 500])
def test_the_report_of_a_fit_fits(tmp_path, width):
    run = make_run(tmp_path / "run", offset_n=0.02)
    write_report(load_finding(run), {}, run / "report.html")
    assert not too_wide((run / "report.html").read_text(encoding="utf-8"), width, tmp_path)


def test_a_table_that_does_not_fit_is_found(tmp_path):
    page = "<html><body><div class='wide' style='overflow-x: auto'><p>{}</p></div></body></html>"
    assert too_wide(page.format("x" * 300), 500, tmp_path).startswith("xxx")
    assert not too_wide(page.format("x"), 500, tmp_path)
