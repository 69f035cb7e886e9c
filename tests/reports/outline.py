"""Pages and data files of plots as tests read them."""

import base64
import json
import zlib
from html.parser import HTMLParser

import numpy as np


class Outline(HTMLParser):
    """``tags``: name and attributes in order; ``text``: what a reader sees."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self._text: list[str] = []
        self._inside: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag in ("script", "style"):
            self._inside.append(tag)

    def handle_endtag(self, tag):
        if self._inside and self._inside[-1] == tag:
            self._inside.pop()

    def handle_data(self, data):
        if not self._inside:
            self._text.append(data)

    @property
    def text(self) -> str:
        return "".join(self._text)

    @property
    def plain(self) -> str:
        """The text with one blank between words, also where only a tag is."""
        return " ".join(" ".join(self._text).split())


def opened(text: str) -> dict:
    """A bundle as the browser opens it, its arrays as numbers."""
    plain = json.loads(text[text.index(" = ") + 3 : text.rindex(";")])
    whole = zlib.decompress(base64.b64decode(plain["packed"]))
    head = int.from_bytes(whole[:4], "little")
    return json.loads(whole[4 : 4 + head], object_hook=lambda v: numbers(v, whole[4 + head :]) if "kind" in v else v)


def numbers(v: dict, stored: bytes) -> np.ndarray:
    width = 2 if v["kind"] == "u2" else 4
    planes = np.frombuffer(stored, np.uint8, width * v["n"], v["at"]).reshape(width, v["n"])
    a = np.frombuffer(np.ascontiguousarray(planes.T).tobytes(), f"<{v['kind']}")
    a = np.cumsum(a, dtype=np.uint16) if v["kind"] == "u2" else a
    if "step" not in v:
        return a
    return np.where(a > 0, np.exp(v["log"] + (a - 1.0) * v["step"]), 0.0) if "log" in v else v["low"] + a * v["step"]
