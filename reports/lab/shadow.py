"""Write the page of ``mbsbench shadow``: findings, and the distance of the computed from the true motion over time."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...harness.lab.shadow.findings import summarise_nearest
from ...harness.lab.shadow.shadow import Shadow
from ...harness.results import environment
from ...harness.results.findings import Finding
from ..plots.spec import Axis, LineStyle, Plot, Trace
from ..rendering import write_file
from ..trial import draw_chart

COLOURS = ("#3D62C7", "#62AF96", "#E08906", "#BB3939", "#A499CF")  # one for each body drawn
PATHS = 3  # bodies whose paths are drawn: the first, the middle and the last
NOTE = (
    "A shadow is computed, not proved: its gaps are below the stated size by an accurate integrator, in double "
    "precision. It is the nearest by least squares, at the same times: no shift of time is allowed."
)


def write_page(path: Path, title: str, found: Sequence[Finding], names: Sequence[str], s: Shadow) -> None:
    """Write the page on a shadow to ``path``: the findings ``found``, and distances and paths of some bodies.

    ``names`` are those of all bodies. Paths are drawn in the plane of the two axes along which bodies move farthest.
    """
    t = Axis("t", "s", symbol="t")
    gap = Axis("|C − C shadow|", "m", log=True, symbol=r"|C - C_{\rm shadow}|")
    colours = {names[b]: LineStyle(COLOURS[k], "o") for k, b in enumerate(_choose_bodies(len(names), len(COLOURS)))}
    lines = [Trace(name, s.t, s.distance[:, names.index(name)], name) for name in colours]
    across, up = np.argsort(-np.ptp(s.given.r.reshape(-1, 3), axis=0))[:2]
    curves = []
    for name in (names[k] for k in _choose_bodies(len(names), PATHS)):
        for words, states, dash in (("computed", s.given, 0), ("true", s.true, 1)):
            r = states.r[:, names.index(name)]
            curves.append(Trace(f"{name}, {words}", r[:, across], r[:, up], name, dash=dash))
    looks = colours | {t.solver: colours.get(t.solver, LineStyle(COLOURS[0], "o")) for t in curves}
    distances = Plot("distance", "Distance of C", "", t, gap, lines)
    paths = Plot("paths", "Paths of C", "", Axis("XYZ"[across], "m"), Axis("XYZ"[up], "m"), curves)
    charts = [
        draw_chart("Distance of each centre of mass from that of the shadow.", [distances], looks),
        draw_chart("Paths of centres of mass: computed, and true (dashed).", [paths], looks),
    ]
    stamp = f"{NOTE} Commit {environment.read_commit()[:12] or 'not recorded'}."
    summary = summarise_nearest(s, None).words or found[0].text
    write_file(path, "trial.html", title=title, card=None, summary=summary, findings=found, charts=charts, stamp=stamp)


def _choose_bodies(n: int, most: int) -> list[int]:
    """Return at most ``most`` of n body indices, equally spaced from first to last."""
    return sorted(set(np.linspace(0, n - 1, most).round().astype(int).tolist()))
