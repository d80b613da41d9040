"""The report in headless Chromium: it fits, prints, and its switches work."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from report_case import Case, solved, without_pose

from easyhecpp.report.html import write_report

CHROMIUM = next(
    (
        path
        for name in ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
        if (path := shutil.which(name))
    ),
    None,
)
pytestmark = pytest.mark.skipif(
    CHROMIUM is None,
    reason="the report is opened in a browser: needs Chromium or Chrome on the PATH",
)

PROBE = """<script>
const shown = kind => getComputedStyle(document.querySelector(`.lines .${kind}`)).visibility;
const box = document.getElementById("show-mask");
const before = shown("mask");
box.click();
const broken = [...document.querySelectorAll("image")].map(i => new Promise(done => {
  const image = new Image();
  image.onload = () => done(0);
  image.onerror = () => done(1);
  image.src = i.getAttribute("href");
}));
Promise.all(broken).then(found => {
  const wide = [...document.querySelectorAll("body *")].filter(
    e => e instanceof HTMLElement &&
      e.getBoundingClientRect().right > document.documentElement.clientWidth + 1);
  document.title = JSON.stringify({
    errors: window.errors, width: document.documentElement.scrollWidth, window: innerWidth,
    wide: wide.map(e => e.tagName + "." + e.className), broken: found.reduce((a, b) => a + b, 0),
    pictures: found.length, views: document.querySelectorAll("article.view").length,
    before, after: shown("mask"),
    loaded: performance.getEntriesByType("resource").filter(
      e => !e.name.startsWith("data:")).length,
  });
});
</script>"""


def chromium(tmp_path: Path, *words: str) -> str:
    assert CHROMIUM is not None
    done = subprocess.run(
        [
            CHROMIUM,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--virtual-time-budget=5000",
            f"--user-data-dir={tmp_path / 'profile'}",
            *words,
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return done.stdout


def probe(tmp_path: Path, case: Case, width: int) -> dict[str, Any]:
    """Open the report, press a switch, and let the page tell about itself in its title."""
    write_report(tmp_path / "report.html", *case.arguments)
    text = (tmp_path / "report.html").read_text("utf-8")
    watch = "<script>window.errors = []; onerror = e => { errors.push(String(e)); };</script>"
    text = text.replace("<head>", f"<head>{watch}", 1).replace("</body>", f"{PROBE}</body>", 1)
    (tmp_path / "probe.html").write_text(text, "utf-8")
    address = (tmp_path / "probe.html").as_uri()
    dom = chromium(tmp_path, f"--window-size={width},900", "--dump-dom", address)
    title = re.search(r"<title>(.*?)</title>", dom, re.S)
    assert title
    return json.loads(html.unescape(title.group(1)))


@pytest.mark.parametrize("width", [1280, 1440])
def test_the_report_fits_a_laptop_and_its_switches_work(tmp_path, width):
    found = probe(tmp_path, solved(), width)
    assert found["errors"] == []
    assert found["width"] <= found["window"] == width
    assert found["wide"] == []
    assert (found["broken"], found["loaded"]) == (0, 0)
    assert found["views"] == 4
    assert found["pictures"] >= 5
    assert (found["before"], found["after"]) == ("visible", "hidden")


def test_the_report_of_a_failure_without_a_pose_opens(tmp_path):
    found = probe(tmp_path, without_pose(), 1280)
    assert found["errors"] == []
    assert found["views"] == 4
    assert found["wide"] == []


def test_the_report_prints_on_few_pages(tmp_path):
    write_report(tmp_path / "report.html", *solved().arguments)
    chromium(
        tmp_path,
        "--no-pdf-header-footer",
        f"--print-to-pdf={tmp_path / 'report.pdf'}",
        (tmp_path / "report.html").as_uri(),
    )
    pdf = (tmp_path / "report.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    pages = len(re.findall(rb"/Type\s*/Page\b", pdf))
    assert 2 <= pages <= 5
