"""The page in a browser: it loads from disk without an error or a request, fits a phone, and its tables sort."""

import base64
import json
import re
import shutil
import subprocess

import pytest

CHROMIUM = next(
    (p for n in ("chromium", "chromium-browser", "google-chrome", "chrome") if (p := shutil.which(n))), None
)
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--allow-file-access-from-files", "--virtual-time-budget=8000",
)  # fmt: skip
EARLY = """<script>window.faults = [];
addEventListener("error", (e) => faults.push(String(e.message || e.target)), true);
console.error = console.warn = (...a) => faults.push(a.join(" "));</script>"""
PROBE = """<script>addEventListener("load", () => setTimeout(() => {
  const head = document.querySelector("table.cells thead th:nth-child(7) button");
  head.click();
  const order = [...head.closest("table").tBodies[0].rows].map((row) => row.cells[6].dataset.v);
  parent.postMessage(JSON.stringify({ faults, width: document.documentElement.scrollWidth, inner: innerWidth, order,
    sorted: head.parentElement.getAttribute("aria-sort"),
    requests: performance.getEntriesByType("resource").map((r) => r.name).filter((n) => !n.startsWith("data:")),
    drawn: [...document.querySelectorAll("figure svg")].filter((s) => s.getBBox().width > 100).length }), "*");
}, 300));</script>"""


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
@pytest.mark.parametrize("width", [390, 1280])
def test_page_in_a_browser(built, tmp_path, width):
    """A frame of the width of a phone: headless windows are never that narrow."""
    _, _, html = built
    page = html.replace("<head>", "<head>" + EARLY, 1).replace("</body>", PROBE + "</body>", 1)
    (tmp_path / "page.html").write_text(page, encoding="utf-8")
    (tmp_path / "outer.html").write_text(
        f'<iframe src="page.html" style="width: {width}px; height: 900px; border: 0"></iframe><pre></pre>'
        '<script>addEventListener("message", (m) => '
        'document.querySelector("pre").textContent = btoa(m.data));</script>',
        encoding="utf-8",
    )
    assert CHROMIUM is not None
    command = [
        CHROMIUM,
        *FLAGS,
        f"--user-data-dir={tmp_path / 'profile'}",
        "--dump-dom",
        f"file://{tmp_path}/outer.html",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    answer = re.search(r"<pre>([\w+/=]+)</pre>", done.stdout)
    assert answer, f"the page did not answer: {done.stderr[-500:]}"
    seen = json.loads(base64.b64decode(answer[1]))
    assert seen["faults"] == []
    assert seen["requests"] == []
    assert seen["inner"] == width and seen["width"] <= width
    assert seen["drawn"] >= 3
    numbers = [float(v) for v in seen["order"] if v]
    assert seen["sorted"] == "ascending" and numbers == sorted(numbers)
    assert all(v == "" for v in seen["order"][len(numbers) :])  # what is not there stays last
