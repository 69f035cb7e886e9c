"""Draw pictures of the README and of docs/judging.md, from the newest or given results; the loop from two new runs.

``make pictures`` writes all. Each states the digest of the code of its runs, and of the code that measured what it
shows, which a test compares with the present code. From results with engines it also writes a false success of each
into results/published/engines, for pages without engines, if the pictures are those of the pages.
"""

import mbsbench  # noqa: F401  before NumPy: it pins the arithmetic

# isort: split
import hashlib
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mbsbench import solve
from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.columns.digests import ColumnDigests
from mbsbench.harness.judge.referee.carried import list_equal_generations
from mbsbench.harness.mechanics.types import ALLOWED, Law
from mbsbench.harness.results.column_digests import add_column_digests, read_stored_digests
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.series import Series
from mbsbench.harness.results.store import LOCAL, write_record
from mbsbench.reports.mechanism.segments import choose_view, read_mechanism
from mbsbench.reports.mechanism.stage import load_poses, place_segments
from mbsbench.reports.mechanism.theatre.scene import read_exact_motion
from mbsbench.reports.model.catalogue import is_engine, name_external_code
from mbsbench.reports.model.frontier import Frontier, find_frontiers
from mbsbench.reports.model.results import StoredResults, read_results
from mbsbench.reports.model.variants import find_plain_label
from mbsbench.reports.model.words import join_words, number, seconds
from mbsbench.reports.pages.runs.overview import ENGINES, list_false_successes
from mbsbench.reports.plots.paper import save_figure
from mbsbench.reports.plots.spec import choose_styles
from mbsbench.reports.publication import list_figures

LABEL, PROBLEM, ENERGY = "recommended", "chain", "chain-recommended-energy"
DRAWN = (  # columns that decide what the pictures show
    "energy_drift_max_J",
    "energy_scale_J",
    "judged_to_s",
    "position_error_judged_m",
    "position_error_max_m",
    "orientation_error_judged_rad",
    "orientation_error_max_rad",
    "reference_own_error_judged_m",
    "reference_own_error_m",
)
COSTS, SUITE, TARGET = "costs", "bench_engines", 1e-3  # [m, rad]
NAMED = {"gc_weak_form": "ODE-GC of the paper", "ida_index3": "SUNDIALS IDA, index 3"}
ROLES = (
    ("gc_weak_form", 1e-3, None, "ODE-GC of the paper, dt = 1 ms"),
    ("ida_index3", None, 1e-5, "SUNDIALS IDA, rtol = 1e-5"),
)
END = 1.2  # [s] of the motion; at 1.3 s the step of IDA on index 3 underflows, and rounding decides what follows
SECONDS, HELD = 6, 0.85  # [s] of the loop; fraction of it in which the picture moves
FRAMES, COUNTS = 60, 24
ROWS = (-13, 24, -29)  # [px] of labels beside their dots
WIDTH, HEIGHT, ROOM, LETTER = 880, 330, 16, 8.0  # [px]
STYLE = (
    "svg { color: #1c2126; background: #fff; font: 14px DejaVu Sans, Verdana, sans-serif } "
    "@media (prefers-color-scheme: dark) { svg { color: #e6e8ea; background: #0d1117 } }"
)


def digest_codes(codes: Iterable[str]) -> str:
    """Return one digest of the code digests ``codes`` of runs."""
    return hashlib.sha256(" ".join(sorted(set(codes))).encode()).hexdigest()[:16]


def digest_drawn(state: ColumnDigests) -> str:
    """Return the digest of the code that measures what pictures show: series, and the columns ``DRAWN``."""
    return digest_codes([state.measuring, *(f"{name} {state.columns.get(name, '')}" for name in DRAWN)])


def list_present_digests() -> list[tuple[str, str]]:
    """List both digests for the runs of suite ``SUITE``, by the present code and by each code with equal bits.

    The second is empty for older code, whose first digest covers it.
    """
    specs = load_suite(SUITE).specs
    return [
        (
            digest_codes(g.digest_run_code(s.problem, s.solver) for s in specs),
            digest_drawn(g.measured) if g.running else "",
        )
        for g in list_equal_generations()
    ]


def describe_code(results: StoredResults) -> str:
    """Return the comment of a picture that names the code of its runs."""
    known = read_stored_digests(results.folder)
    measured = {digest_drawn(known[d]) if (d := c.record.measured_by) in known else d for c in results.runs} - {""}
    words = f", measured by {measured.pop() if len(measured) == 1 else digest_codes(measured)}" if measured else ""
    return f"<!-- code of its runs: {digest_codes(r.record.code for r in results.runs)}{words} -->"


def draw_results(folder: Path, out: Path) -> None:
    """Draw the CPU time for an error with engines, and the energy errors on the chain; write both into ``out``."""
    results = read_results(folder, check_series=False)
    variant = next((v for v in results.variants if v.title == PROBLEM), None)
    if variant is None:
        raise SystemExit(f"error: {folder} holds no runs of the chain: make engines bench")
    draw = next(draw for name, _, _, draw in list_figures(results, variant) if name == ENERGY)
    (path,) = save_figure(draw, ConfinedPath(out), PROBLEM, ("svg",))
    code = describe_code(results)
    for place, text in ((path, path.read_text(encoding="utf-8")), (out / f"{COSTS}.svg", draw_costs(results))):
        place.write_text(f"{text}{code}\n", encoding="utf-8")


OWN = Path(__file__).resolve().parent / "images"


def publish_engines(folder: Path) -> None:
    """Replace the published false successes of engines by the worst one of each engine in these results."""
    results = read_results(folder, check_series=False)
    cards, _, _ = list_false_successes(results, find_plain_label(results))
    (ENGINES / "runs").mkdir(parents=True, exist_ok=True)
    for old in (ENGINES / "runs").glob("*.json"):
        old.unlink()
    for run in (c["run"] for c in cards if is_engine(c["run"].record.solver)):
        write_record(ENGINES, replace(run.record, series="", stderr=""))
    add_column_digests(ENGINES, *read_stored_digests(folder).values())


def draw_costs(results: StoredResults) -> str:
    """Return an SVG with a row of dots per problem that an engine ran: solvers by CPU time at one error."""
    found = [f for f in find_frontiers(results) if f.target == TARGET and any(map(is_engine, _solvers(f)))]
    last: dict[str, Frontier] = {}
    for f in found:
        last[f.variant.partition("[")[0]] = f  # of the two pendulums the spatial one
    factors = [p.factor for f in last.values() for p in f.places if is_engine(p.run.record.solver)]
    costs = [p.cpu_s for f in last.values() for p in f.places] or [1.0]
    low = math.floor(math.log10(min(costs)))
    high = max(math.ceil(math.log10(max(costs))), low + 1)
    left, right = 170, WIDTH - 40

    def x(cpu: float) -> float:
        return left + (right - left) * (math.log10(cpu) - low) / (high - low)

    ends = f"{number(min(factors, default=1.0), 2)} to {number(max(factors, default=1.0), 2)}"
    title = f"An error of 1 mm or 1 mrad: engines that get there need {ends} times the CPU time of the cheapest"
    parts = [_text(ROOM, 24, title, "", ' font-weight="bold"')]
    tall = 88
    for k in range(low, high + 1):
        parts.append(f'<path d="M{x(10.0**k):.0f} 44V{44 + tall * len(last)}" stroke="currentColor" opacity="0.15"/>')
        words = f"{10.0**k:g} s" if k > -2 else f"{10.0 ** (k + 3):g} ms"
        parts.append(_text(round(x(10.0**k)) - 16, 62 + tall * len(last), words))
    for k, (name, f) in enumerate(last.items()):
        parts += [_text(ROOM, 88 + tall * k, name.replace("_", " ")), *_draw_row(f, x, 84 + tall * k, right)]
    height = 76 + tall * len(last)
    return _svg(height, parts)


def _solvers(f: Frontier) -> list[str]:
    """List the solvers that reach an error, then those that miss it."""
    return [*(p.run.record.solver for p in f.places), *f.missed]


def _draw_row(f: Frontier, x: Callable[[float], float], y: int, right: float) -> Iterator[str]:
    """Yield the SVG elements of a problem's row: dots, labels in the row of ``ROWS`` with room, and who misses it."""
    own, ends = choose_styles(_solvers(f)), [0.0] * len(ROWS)
    for k, p in enumerate(f.places):
        name, at = p.run.record.solver, x(p.cpu_s)
        said = _choose_label(name) or (name if k == 0 else "")
        yield (
            f'<circle cx="{at:.1f}" cy="{y}" r="{5 if said else 3}" fill="{own[name].colour}" '
            f'opacity="{1 if said else 0.45}"><title>{name} {seconds(p.cpu_s)}</title></circle>'
        )
        if said:
            words = f"{said} {'≤ ' * p.bound}{seconds(p.cpu_s)}"
            wide = LETTER * len(words)
            best = min(at - 0.5 * wide, right - wide + 30.0)
            row = min(range(len(ROWS)), key=lambda r: max(ends[r] - best, 0.0))
            start = min(max(ends[row], best), right - wide + 30.0)
            ends[row] = start + wide + 12.0
            if start > at:  # the label was moved to leave room for the one before: draw a line to its dot
                yield (
                    f'<path d="M{at:.1f} {y}L{start - 3:.1f} {y + ROWS[row] - 5}" stroke="currentColor" opacity="0.5"/>'
                )
            yield _text(round(start), y + ROWS[row], words)
    missed = [_choose_label(s) for s in f.missed if _choose_label(s)]
    if missed:
        yield _text(ROOM, y + 44, f"not reached by {join_words(missed)} at any setting tried", "", ' opacity="0.7"')


def _choose_label(solver: str) -> str:
    """Return the name by which a solver is labelled; empty if it has no label."""
    return NAMED.get(solver) or (name_external_code(solver) if is_engine(solver) and solver != "cvode" else "")


def draw_loop() -> str:
    """Solve the falling chain by two solvers; return an animated SVG of both, the exact motion and the errors."""
    runs = [solve(PROBLEM, name, t_end=END, dt=dt, rtol=rtol) for name, dt, rtol, _ in ROLES]
    series = [run.series for run in runs if run.series is not None]
    bodies, exact = read_mechanism(series[0]), read_exact_motion(series[0])
    if bodies is None or exact is None:
        raise SystemExit(f"error: {runs[0]} kept no poses")
    t = np.linspace(0.0, END, FRAMES)
    view = choose_view(bodies)
    moving = [place_segments(bodies, exact, t, view)]
    moving += [place_segments(bodies, load_poses(s), t, view) for s in series]
    low, high = np.min(moving[0], axis=(0, 1, 2)), np.max(moving[0], axis=(0, 1, 2))
    scale = (HEIGHT - 2 * ROOM) / (high - low)[1]
    corner = np.array([ROOM - scale * low[0], HEIGHT - ROOM + scale * low[1]])
    colours = ["", *(choose_styles([name])[name].colour for name, *_ in ROLES)]
    parts = [
        _draw_motion(corner + scale * lines * [1.0, -1.0], colour)
        for lines, colour in zip(moving, colours, strict=True)
    ]
    left = round(ROOM + scale * (high - low)[0] + 2 * ROOM)
    parts.append(_text(left, 50, f"exact: a chain of 15 links falls for {END:g} s"))
    for k, (run, own, (name, *_, words)) in enumerate(zip(runs, series, ROLES, strict=True)):
        parts.append(_text(left, 105 + 115 * k, f"{name}, {words}", colours[1 + k]))
        parts += _draw_error(left, 130 + 115 * k, run.record, own, colours[1 + k])
    return _svg(HEIGHT, parts)


def _svg(height: int, parts: Iterable[str]) -> str:
    """Return an SVG of that height [px] with these parts."""
    size = f'width="{WIDTH}" height="{height}" viewBox="0 0 {WIDTH} {height}"'
    inside = "\n".join((f"<style>{STYLE}</style>", *parts))
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n{inside}\n</svg>\n'


def _draw_motion(frames: np.ndarray, colour: str) -> str:
    """Return the SVG element of a moving mechanism; ``frames`` are its segments [px] over time."""
    ways = ["".join(f"M{a:.0f} {b:.0f}L{c:.0f} {d:.0f}" for a, b, c, d in f.reshape(-1, 4)) for f in frames]
    look = (
        f'fill="none" stroke="{colour or "currentColor"}" stroke-width="{2.5 if colour else 5}" stroke-linecap="round"'
    )
    return f'<path {look} d="{ways[-1]}">{_animate("d", ways, "linear")}</path>'


def _draw_error(x: int, y: int, r: RunRecord, series: Series, colour: str) -> list[str]:
    """Return SVG texts on a run: its error in each part of the time (the last stays), its status and energy error."""
    times = np.linspace(0.0, END, COUNTS)
    off = np.interp(times, series["t"], 1e3 * series["position_error"])
    out = []
    for k, value in enumerate(off):
        shown = ["1" if k == i else "0" for i in range(COUNTS)]
        inside = _animate("opacity", shown, "discrete")
        last = "1" if k == COUNTS - 1 else "0"
        out.append(_text(x, y, f"position error {value:.1f} mm", colour, f' opacity="{last}"', inside))
    allowed = number(ALLOWED[Law.ENERGY] * r.energy_scale_J, 2)
    energy = f"energy error {number(r.energy_drift_max_J, 2)} J of {allowed} J allowed"
    return [*out, _text(x, y + 25, f"says {r.claimed}, is {r.status}", colour), _text(x, y + 50, energy, colour)]


def _animate(name: str, values: Sequence[str], mode: str) -> str:
    """Return the SVG animation of an attribute over the loop, at whose end the last value is held."""
    at = ";".join(f"{t:.3f}" for t in (*np.linspace(0.0, HELD, len(values)), 1.0))
    way = f'values="{";".join((*values, values[-1]))}" keyTimes="{at}" calcMode="{mode}"'
    return f'<animate attributeName="{name}" dur="{SECONDS}s" repeatCount="indefinite" {way}/>'


def _text(x: int, y: int, words: str, colour: str = "", extra: str = "", inside: str = "") -> str:
    """Return the SVG element of a text at ``x``, ``y`` [px]."""
    return f'<text x="{x}" y="{y}" fill="{colour or "currentColor"}"{extra}>{words}{inside}</text>'


if __name__ == "__main__":
    place = Path(sys.argv[2])
    given = Path(sys.argv[1])
    folder = given if given.is_dir() else LOCAL / given
    draw_results(folder, place)
    if place.resolve() == OWN:
        publish_engines(folder)
    (place / "loop.svg").write_text(draw_loop(), encoding="utf-8")
