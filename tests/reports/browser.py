"""A headless Chromium that tests talk to through two pipes (DevTools protocol): no driver, no socket, no package.

with Browser() as browser:
tab = browser.open(path, width=390, dark=True)
assert tab.faults == [] and tab.requests == []
tab.evaluate("document.title"); tab.ink("[data-plot=energy]"); tab.screenshot("page.png", whole=True)
"""

import base64
import contextlib
import io
import itertools
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np
from PIL import Image

AXE = Path(__file__).parents[2] / ".venv" / "axe" / "package" / "axe.min.js"
NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
CHROMIUM = next((p for n in (os.environ.get("CHROMIUM", ""), *NAMES) if n and (p := shutil.which(n))), None)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-sync",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-extensions",
    "--hide-scrollbars",
    "--mute-audio",
    "--remote-debugging-pipe",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
BECOME = (
    "import os, sys; r, w = map(int, sys.argv[1:3]); r, w = os.dup(os.dup(r)), os.dup(os.dup(w)); "
    "os.dup2(r, 3); os.dup2(w, 4); os.execv(sys.argv[3], sys.argv[3:])"
)
PATIENCE = 60.0  # [s] for one answer: the machine may be busy
REPLACED = ("navigated or closed", "context was destroyed", "Cannot find context")
LOCAL = ("file:", "data:", "blob:", "about:")
OVERFLOW = "document.documentElement.scrollWidth - innerWidth"
OPEN = "document.querySelectorAll('details').forEach((e) => { e.open = true; })"
# text that is too pale on what is behind it (WCAG AA)
PALE = """
(() => {
  const numbers = (c) => c.match(/[\\d.]+/g).map(Number);
  const linear = (v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
  const light = (c) => 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
  const behind = (e) => {
    for (; e; e = e.parentElement) {
      const c = numbers(getComputedStyle(e).backgroundColor);
      if (c.length < 4 || c[3] === 1) return c;
    }
    return [255, 255, 255];
  };
  const says = (e) => [...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim()) && e.getClientRects().length;
  const out = [];
  for (const e of document.querySelectorAll("main *, nav *, footer *")) {
    if (e.closest("svg") || !says(e)) continue;
    const style = getComputedStyle(e), [a, b] = [light(numbers(style.color)), light(behind(e))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    if (ratio < (large ? 3 : 4.5)) out.push(`${e.tagName}.${e.className} ${ratio.toFixed(2)}`);
  }
  return out;
})()
"""
# on a phone: text below 12 px, controls below 24 px; links in running text are no controls
SMALL = """
[...document.querySelectorAll("body *")].filter((e) => !e.closest("svg, script, style, .hidden")
  && e.getClientRects().length && [...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim())
  && parseFloat(getComputedStyle(e).fontSize) < 11.95)
  .map((e) => `${e.tagName}.${e.className} ${getComputedStyle(e).fontSize}`)
"""
LOW = """
[...document.querySelectorAll("nav a, button, select, input, summary, .button, .heat td > a")]
  .filter((e) => e.getClientRects().length && e.getBoundingClientRect().height < 24)
  .map((e) => `${e.tagName}.${e.className} ${e.getBoundingClientRect().height}`)
"""
VIOLATIONS = """
axe.run(document, {resultTypes: ["violations"]}).then((r) => r.violations.flatMap((v) => v.nodes.map((n) =>
  `${v.id} ${n.target}: ${n.failureSummary.split("\\n").slice(1).join(" ")}`)))
"""
SETTLED = "new Promise(f => requestAnimationFrame(() => requestAnimationFrame(() => f(true))))"


class Browser:
    """One process; close it, or use it in a ``with``."""

    def __init__(self) -> None:
        if CHROMIUM is None:
            raise RuntimeError("no chromium on this machine")
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        read, self._write = os.pipe()
        self._read, write = os.pipe()
        command = [sys.executable, "-c", BECOME, str(read), str(write), CHROMIUM, *FLAGS]
        self._process = subprocess.Popen(
            [*command, f"--user-data-dir={self._profile.name}"],
            pass_fds=(read, write),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(read)
        os.close(write)
        self._buffer, self._number = b"", 0
        self._tabs: dict[str, Tab] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close_tabs(self) -> None:
        """All that are open."""
        while self._tabs:
            next(iter(self._tabs.values())).close()

    def close(self) -> None:
        """End the process."""
        os.close(self._write)
        os.close(self._read)
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._profile.cleanup()

    def open(self, page: Path | str, *, width: int = 1280, height: int = 900, dark: bool = False) -> "Tab":
        """A tab with a file (``path`` or ``path#anchor``), loaded and drawn."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        tab = self._tabs[session] = Tab(self, session, target)
        tab.begin(str(page), width, height, dark)
        return tab

    def call(self, method: str, session: str = "", **parameters: Any) -> dict[str, Any]:
        """Ask, and wait for the answer."""
        self._number += 1
        number = self._number
        message: dict[str, Any] = {"id": number, "method": method, "params": parameters}
        if session:
            message["sessionId"] = session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        answer = self.wait(lambda m: m.get("id") == number, method)
        if "error" in answer:
            fault = f"{method}: {answer['error'].get('message')}"
            raise (Replaced if any(words in fault for words in REPLACED) else RuntimeError)(fault)
        return answer["result"]

    def wait(self, wanted: Callable[[dict[str, Any]], bool], what: str) -> dict[str, Any]:
        """The next message that is ``wanted``; what tabs should know goes to them."""
        end = time.monotonic() + PATIENCE
        while True:
            while b"\0" in self._buffer:
                raw, self._buffer = self._buffer.split(b"\0", 1)
                message = json.loads(raw)
                if "method" in message and message.get("sessionId") in self._tabs:
                    self._tabs[message["sessionId"]].hear(message["method"], message["params"])
                if wanted(message):
                    return message
            ready, _, _ = select.select([self._read], [], [], max(end - time.monotonic(), 0.0))
            part = os.read(self._read, 1 << 20) if ready else b""
            if not part:
                raise TimeoutError(f"the browser did not answer: {what}")
            self._buffer += part


class Replaced(RuntimeError):
    """The page that was asked is gone: another one is being loaded."""


class Tab:
    """A page. ``faults``: what its console complains of; ``requests``: addresses beyond the disk that it asked for."""

    def __init__(self, browser: Browser, session: str, target: str) -> None:
        self.browser, self.session, self.target = browser, session, target
        self.faults: list[str] = []
        self.requests: list[str] = []
        self.opened_s = float("nan")

    def begin(self, page: str, width: int, height: int, dark: bool) -> None:
        """Load ``page`` as a device of that width sees it."""
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.look(width, height, dark)
        self.goto(page)

    def look(self, width: int, height: int, dark: bool) -> None:
        """Become a device of that size, in light or dark."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def violations(self) -> list[str]:
        """Findings of axe-core, light and dark, on a desktop and a phone, with all that is folded opened."""
        self.evaluate(f"{OPEN}; {AXE.read_text(encoding='utf-8')}; 0")
        found = []
        for width, dark in itertools.product((1280, 390), (False, True)):
            self.look(width, 900, dark)
            self.evaluate(SETTLED)
            where = f"{width} px{', dark' if dark else ''}"
            found += [f"{where}: {one}" for one in self.evaluate(VIOLATIONS)]
        return found

    def goto(self, page: Path | str) -> None:
        """Another page in the same tab; ``opened_s`` is the wall time until it was loaded and drawn."""
        path, hash_, anchor = str(page).partition("#")
        began = time.monotonic()
        answer = self.call("Page.navigate", url=Path(path).resolve().as_uri() + hash_ + anchor)
        if answer.get("errorText"):
            raise RuntimeError(f"{page}: {answer['errorText']}")
        self.browser.wait(
            lambda m: m.get("method") == "Page.loadEventFired" and m.get("sessionId") == self.session, f"load {page}"
        )
        self.evaluate(SETTLED)
        self.opened_s = time.monotonic() - began

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A command for this tab."""
        return self.browser.call(method, self.session, **parameters)

    def hear(self, method: str, p: dict[str, Any]) -> None:
        """Keep what went wrong and what was asked for."""
        if method == "Runtime.exceptionThrown":
            d = p["exceptionDetails"]
            self.faults.append(f"{d.get('text')} {d.get('exception', {}).get('description', '')} {d.get('url', '')}")
        elif method == "Runtime.consoleAPICalled" and p["type"] in ("error", "warning", "assert"):
            self.faults.append(" ".join(str(a.get("value", a.get("description"))) for a in p["args"]))
        elif method == "Log.entryAdded" and p["entry"]["level"] in ("error", "warning"):
            self.faults.append(f"{p['entry']['text']} {p['entry'].get('url', '')}")
        elif method == "Network.requestWillBeSent" and not p["request"]["url"].startswith(LOCAL):
            self.requests.append(p["request"]["url"])

    def evaluate(self, script: str) -> Any:
        """The value of an expression; a promise is awaited."""
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise RuntimeError(details.get("exception", {}).get("description") or details["text"])
        return answer["result"].get("value")

    def until(self, condition: str, seconds: float = 20.0) -> None:
        """Wait till an expression is true; a page that is being replaced says nothing yet."""
        end = time.monotonic() + seconds
        while True:
            with contextlib.suppress(Replaced):
                if self.evaluate(f"Boolean({condition})"):
                    return
            if time.monotonic() > end:
                raise TimeoutError(f"never true: {condition}; console: {self.faults}")
            time.sleep(0.05)

    def press(self, key: str) -> None:
        """A key on the keyboard, e.g. ``Tab``, ``Enter``, ``ArrowRight``."""
        text = {"Enter": "\r", "Space": " "}.get(key, "")
        name = " " if key == "Space" else key
        code = {"Enter": 13, "Tab": 9, "Space": 32, "ArrowLeft": 37, "ArrowRight": 39}.get(key, 0)
        for kind in ("keyDown" if text else "rawKeyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent",
                type=kind,
                key=name,
                code=key,
                text=text if kind == "keyDown" else "",
                windowsVirtualKeyCode=code,
            )

    def click(self, selector: str, at: tuple[float, float] = (0.5, 0.5)) -> None:
        """The mouse on a part of an element, brought into view."""
        x, y, w, h = self.box(selector)
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.call(
                "Input.dispatchMouseEvent", type=kind, x=x + at[0] * w, y=y + at[1] * h, button="left", clickCount=1
            )

    def box(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height in the window, after scrolling there."""
        script = f"""(() => {{ const e = document.querySelector({json.dumps(selector)});
            e.scrollIntoView({{block: "center"}}); const b = e.getBoundingClientRect();
            return [b.x, b.y, b.width, b.height]; }})()"""
        x, y, w, h = self.evaluate(script)
        return x, y, w, h

    def screenshot(self, path: Path | str = "", *, whole: bool = False, selector: str = "") -> np.ndarray:
        """Pixels (height, width, 3); of the ``whole`` page, or of one element; as a file if ``path`` is given."""
        extra: dict[str, Any] = {}
        if selector:
            x, y, w, h = self.box(selector)
            sx, sy = self.evaluate("[scrollX, scrollY]")
            extra = {"clip": {"x": x + sx, "y": y + sy, "width": w, "height": h, "scale": 1}}
        elif whole:
            w, h = self.evaluate("[document.documentElement.clientWidth, document.documentElement.scrollHeight]")
            extra = {"clip": {"x": 0, "y": 0, "width": w, "height": h, "scale": 1}, "captureBeyondViewport": True}
        png = base64.b64decode(self.call("Page.captureScreenshot", format="png", **extra)["data"])
        if path:
            Path(path).write_bytes(png)
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))

    def ink(self, selector: str, far: int = 40) -> float:
        """Share of an element's pixels that are ``far`` from its commonest colour: nothing drawn is 0."""
        pixels = self.screenshot(selector=selector).reshape(-1, 3).astype(int)
        colours, counts = np.unique(pixels, axis=0, return_counts=True)
        away = np.abs(pixels - colours[np.argmax(counts)]).max(axis=1)
        return float(np.mean(away > far))

    def close(self) -> None:
        """Close the tab."""
        self.browser.call("Target.closeTarget", targetId=self.target)
        del self.browser._tabs[self.session]
