"""The sketch of a mechanism: names stand beside its bars."""

import re

import numpy as np
import pytest

from mbsbench.reports.mechanism.segments import Picture
from mbsbench.reports.pages.svg import draw_sketch


def bars(angles: list[float]) -> np.ndarray:
    """A row of bars of length 1 from the origin, both ends of each."""
    steps = np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    ends = np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
    return np.stack((ends[:-1], ends[1:]), axis=1)


@pytest.mark.parametrize("angles", [[-1.2, -0.9, 0.0, 0.9, 1.2], [-1.57], [0.0, 0.01, 0.0], [0.8, -0.8] * 6])
def test_names_hide_no_bar(angles):
    """Neither a bar nor a joint runs through the box of a name's letters, 6 px wide and 12 px high each."""
    lines = bars(angles)
    names = [("bar 1", lines[0].mean(axis=0)), (f"bar {len(lines)}", lines[-1].mean(axis=0))]
    drawing = str(draw_sketch(Picture(lines, lines[:, 0], lines[:1, 0], (), tuple(names)), "a chain"))
    drawn = [
        [float(v) for v in found]
        for found in re.findall(r'class="body" x1="([^"]+)" x2="([^"]+)" y1="([^"]+)" y2="([^"]+)"', drawing)
    ]
    placed = re.findall(r'class="name" x="([^"]+)" y="([^"]+)"[^>]*>([^<]+)<', drawing)
    assert len(drawn) == len(lines) and len(placed) == 2
    for x, y, name in placed:
        for x1, x2, y1, y2 in drawn:
            u = np.linspace(0.0, 1.0, 200)
            across, up = x1 + u * (x2 - x1) - float(x), y1 + u * (y2 - y1) - float(y) + 4.0
            assert not np.any((np.abs(across) < 3.0 * len(name)) & (np.abs(up) < 6.0))
