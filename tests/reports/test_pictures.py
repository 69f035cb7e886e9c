"""Pictures of the README are drawn from the code that is here."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
IMAGES = ROOT / "docs" / "images"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


@pytest.fixture(scope="module")
def pictures():
    sys.path.insert(0, str(ROOT / "docs"))
    import draw_pictures

    sys.path.pop(0)
    return draw_pictures


@pytest.mark.parametrize("name", ["overview", "chain"])
def test_pictures_of_results_are_of_runs_by_this_code(pictures, name):
    """What they are drawn from takes minutes, so that the digest of its code stands for it."""
    (code,) = re.findall(r"<!-- code of its runs: (\w+) -->", (IMAGES / f"{name}.svg").read_text(encoding="utf-8"))
    assert code == pictures.code_now(), "make bench pictures"


def test_the_loop_is_drawn_from_runs_of_this_code(pictures):
    """All words are the same, and no number is off by more than another processor's rounding moves it."""
    kept, drawn = (IMAGES / "loop.svg").read_text(encoding="utf-8"), pictures.draw_loop()
    assert NUMBER.sub("", kept) == NUMBER.sub("", drawn), "make pictures"
    pairs = zip(NUMBER.findall(kept), NUMBER.findall(drawn), strict=True)
    assert max(abs(float(a) - float(b)) - 0.01 * abs(float(b)) for a, b in pairs) <= 1.0, "make pictures"


def test_the_loop_lasts_six_seconds_and_shows_the_last_moment_without_animation(pictures):
    """A reader that moves nothing sees the end: every path and count stands on its last value."""
    drawn = pictures.draw_loop()
    assert set(re.findall(r'dur="(\w+)"', drawn)) == {"6s"}
    ends = re.findall(r' d="([^"]+)"><animate[^>]* values="([^"]+)"', drawn)
    assert len(ends) == 1 + len(pictures.ROLES) and all(one.endswith(f";{still}") for still, one in ends)
    shown = re.findall(r'opacity="1">off by ([\d.]+) mm', drawn)
    assert len(shown) == 2 and 10.0 * float(shown[0]) < float(shown[1])
