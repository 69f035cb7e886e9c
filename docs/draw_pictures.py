"""Pictures of the README and of docs/judging.md, from the newest or given results; the loop from two runs made here.

``make pictures`` writes all. Each states the digest of the code of its runs, which a test compares with the code there.
"""

import hashlib
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from mbsbench import solve
from mbsbench.harness.places import Place
from mbsbench.harness.results.codes import code_of
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.series import Series
from mbsbench.harness.results.store import LOCAL
from mbsbench.harness.suites.suite import load_suite
from mbsbench.reports.mechanism.segments import mechanism_of
from mbsbench.reports.mechanism.stage import segments_at, stored
from mbsbench.reports.mechanism.theatre.scene import stored_exact
from mbsbench.reports.mechanism.view import view_of
from mbsbench.reports.model.heat import heat
from mbsbench.reports.model.results import read_results
from mbsbench.reports.model.words import number
from mbsbench.reports.plots.heatmap import heat_figure
from mbsbench.reports.plots.palette import looks
from mbsbench.reports.plots.style import save
from mbsbench.reports.publication import figures_of

LABEL, PROBLEM, ENERGY = "recommended", "chain", "chain-recommended-energy"
ROLES = (("gc_weak_form", 1e-3, None, "ODE-GC of the paper"), ("ida_index3", None, 1e-5, "IDA on index 3"))
END, SECONDS, HELD = 1.6, 6, 0.85  # [s] of the motion, while it is predictable; of the loop; the share that moves
FRAMES, COUNTS = 60, 24
WIDTH, HEIGHT, ROOM = 880, 330, 16  # [px]
STYLE = (
    "svg { color: #1c2126; font: 14px DejaVu Sans, Verdana, sans-serif } "
    "@media (prefers-color-scheme: dark) { svg { color: #e6e8ea } }"
)


def digest(codes: Iterable[str]) -> str:
    """Of the code that runs were made with."""
    return hashlib.sha256(" ".join(sorted(set(codes))).encode()).hexdigest()[:16]


def code_now() -> str:
    """The same of the code that is there, for the runs of the heat map."""
    return digest(code_of(s.problem, s.solver) for s in load_suite("paper").specs if s.label == LABEL)


def draw_results(folder: Path, out: Path) -> None:
    """The heat map and the energy errors on the chain."""
    results = read_results(folder, check_series=False)
    picture = heat(results)
    if picture is None:
        raise SystemExit(f"error: {folder} holds no runs of the suite `paper`: make bench")
    variant = next(v for v in results.variants if v.title == PROBLEM)
    energy = next(p for p in figures_of(results, variant) if p.name == ENERGY)
    code = digest(r.record.code for r in results.runs if r.record.label == LABEL)
    for name, draw in (("overview", lambda: heat_figure(picture)), (PROBLEM, energy.draw)):
        (path,) = save(draw, Place(out), name, ("svg",))
        path.write_text(f"{path.read_text(encoding='utf-8')}<!-- code of its runs: {code} -->\n", encoding="utf-8")


def draw_loop() -> str:
    """The chain falling, exact and by two solvers, with how far off each is, as an SVG that moves by itself."""
    runs = [solve(PROBLEM, name, t_end=2.0, dt=dt, rtol=rtol) for name, dt, rtol, _ in ROLES]
    series = [run.series for run in runs if run.series is not None]
    bodies, exact = mechanism_of(series[0]), stored_exact(series[0])
    if bodies is None or exact is None:
        raise SystemExit(f"error: {runs[0]} kept no poses")
    t = np.linspace(0.0, END, FRAMES)
    view = view_of(bodies)
    moving = [segments_at(bodies, exact, t, view)]
    moving += [segments_at(bodies, stored(s), t, view) for s in series]
    low, high = np.min(moving[0], axis=(0, 1, 2)), np.max(moving[0], axis=(0, 1, 2))
    scale = (HEIGHT - 2 * ROOM) / (high - low)[1]
    corner = np.array([ROOM - scale * low[0], HEIGHT - ROOM + scale * low[1]])
    colours = ["", *(looks([name])[name].colour for name, *_ in ROLES)]
    parts = [_path(corner + scale * lines * [1.0, -1.0], colour) for lines, colour in zip(moving, colours, strict=True)]
    left = round(ROOM + scale * (high - low)[0] + 2 * ROOM)
    parts.append(_text(left, 50, "exact: a chain of 15 links falls"))
    for k, (run, own, (name, *_, words)) in enumerate(zip(runs, series, ROLES, strict=True)):
        parts.append(_text(left, 105 + 100 * k, f"{name}, {words}", colours[1 + k]))
        parts += _count(left, 130 + 100 * k, run.record, own, colours[1 + k])
    size = f'width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}"'
    inside = "\n".join((f"<style>{STYLE}</style>", *parts))
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n{inside}\n</svg>\n'


def _path(frames: np.ndarray, colour: str) -> str:
    """A mechanism that moves; ``frames`` are segments [px] over time."""
    ways = ["".join(f"M{a:.0f} {b:.0f}L{c:.0f} {d:.0f}" for a, b, c, d in f.reshape(-1, 4)) for f in frames]
    look = (
        f'fill="none" stroke="{colour or "currentColor"}" stroke-width="{2.5 if colour else 5}" stroke-linecap="round"'
    )
    return f'<path {look} d="{ways[-1]}">{_moved("d", ways, "linear")}</path>'


def _count(x: int, y: int, r: RunRecord, series: Series, colour: str) -> list[str]:
    """How far off a run is, a text for each part of the time; the last one stays."""
    times = np.linspace(0.0, END, COUNTS)
    off = np.interp(times, series["t"], 1e3 * series["position_error"])
    out = []
    for k, value in enumerate(off):
        shown = ["1" if k == i else "0" for i in range(COUNTS)]
        inside = _moved("opacity", shown, "discrete")
        last = "1" if k == COUNTS - 1 else "0"
        out.append(_text(x, y, f"off by {value:.1f} mm", colour, f' opacity="{last}"', inside))
    verdict = f"says {r.claimed}, is {r.status}: energy off by {number(r.energy_drift_max_J, 2)} J"
    return [*out, _text(x, y + 25, verdict, colour)]


def _moved(name: str, values: Sequence[str], mode: str) -> str:
    """An attribute over the loop; the last value is held."""
    at = ";".join(f"{t:.3f}" for t in (*np.linspace(0.0, HELD, len(values)), 1.0))
    way = f'values="{";".join((*values, values[-1]))}" keyTimes="{at}" calcMode="{mode}"'
    return f'<animate attributeName="{name}" dur="{SECONDS}s" repeatCount="indefinite" {way}/>'


def _text(x: int, y: int, words: str, colour: str = "", extra: str = "", inside: str = "") -> str:
    return f'<text x="{x}" y="{y}" fill="{colour or "currentColor"}"{extra}>{words}{inside}</text>'


if __name__ == "__main__":
    place = Path(sys.argv[2])
    given = Path(sys.argv[1])
    draw_results(given if given.is_dir() else LOCAL / given, place)
    (place / "loop.svg").write_text(draw_loop(), encoding="utf-8")
