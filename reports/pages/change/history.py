"""Results over time and commits: a line for each run, and what each results folder amounted to."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....harness.files import FileError
from ....harness.places import NotOwn
from ....harness.results.history import find_histories, merge_rows, read_folder, read_rows
from ....harness.results.rows import Row
from ...model.results import Results, group_by
from ...model.tables import format_csv
from ...model.words import Mark, mark
from ..base import Page, Site
from ..svg import sparkline

COMMITTED = Path(__file__).resolve().parents[3] / "results" / "history"
MOVED = 0.01  # relative: the gate calls less than that no move
LITTLE = 1e-9  # of the problem's energy: a drift below is rounding whatever its ratio
GATE = {
    "PASS": Mark("✓", "pass", "good"), "XFAIL": Mark("○", "fails as expected", "refused"),
    "XPASS": Mark("!", "passes against expectation", "failed"), "FAIL": Mark("✗", "fail", "wrong"),
}  # fmt: skip
SHOWN = 60  # runs on the page, what got worse most first; the table file has all
WORSE = {"good": 0, "inaccurate": 1, "refused": 2, "failed": 2, "wrong": 3}  # endings, worth more than digits
ENDING = 100.0  # [digits]
HEADS = ("case", "runs", "changed", "ending_first", "ending_last", "energy_drift_max_J_first",
         "energy_drift_max_J_last", "error_m_first", "error_m_last", "cpu_over_first", "gate")  # fmt: skip
TABLE = "data/history.csv"
LEAST = 2  # commits: one is no history
MOST = 24  # results whose marks are shown in a row, the newest


@dataclass(frozen=True)
class Line:
    """One run over all results."""

    settings: str
    case: str
    problem: str
    solver: str
    rows: tuple[Row, ...]

    @property
    def marks(self) -> tuple[Mark, ...]:
        return tuple(mark(r.status) for r in self.rows)

    @property
    def gates(self) -> tuple[Mark, ...]:
        return tuple(gate_mark(r.gate) for r in self.rows if r.gate)

    def values(self, metric: str) -> tuple[float, ...]:
        return tuple(float(getattr(r, metric)) for r in self.rows)

    @property
    def errors(self) -> tuple[float, ...]:
        """The judged error, of positions; the whole one where nothing was judged yet."""
        pairs = zip(self.values("position_error_judged_m"), self.values("position_error_max_m"), strict=True)
        return tuple(whole if math.isnan(judged) else judged for judged, whole in pairs)

    @property
    def told(self) -> tuple[tuple[tuple[float, ...], float], ...]:
        """Drift and error, each with what is little of it."""
        scale = max((r.energy_scale_J for r in self.rows if r.energy_scale_J > 0.0), default=1.0)
        return (self.values("energy_drift_max_J"), LITTLE * scale), (self.errors, LITTLE)

    @property
    def changed(self) -> bool:
        """Its ending, its drift or its error is not what it was at first."""
        return len({r.status for r in self.rows}) > 1 or any(has_moved(*told) for told in self.told)

    @property
    def lost(self) -> float:
        """Digits lost from the first results to the last, in the drift or the error; negative where they were won."""
        ends = [(max(v[0], least), max(v[-1], least)) for v, least in self.told]
        digits = [math.log10(b / a) for a, b in ends if math.isfinite(a) and math.isfinite(b)]
        first, last = (WORSE.get(m.kind, 0) for m in (self.marks[0], self.marks[-1]))
        return max(digits, key=abs, default=0.0) + ENDING * (last - first)


def gate_mark(state: str) -> Mark:
    """The state of the gate on a run."""
    return GATE.get(state, Mark("?", state.lower() or "not judged", "refused"))


def has_moved(values: Sequence[float], least: float) -> bool:
    """Whether known values spread by more than a hundredth, and by more than ``least``."""
    known = [v for v in values if math.isfinite(v)]
    return len(known) > 1 and max(known) - min(known) > max(MOVED * max(map(abs, known)), least)


def gather(results: Results, committed: Path = COMMITTED) -> tuple[tuple[Row, ...], list[str]]:
    """All rows of results beside these and of committed files, and what could not be read."""
    folders, files = find_histories(results.folder.resolve().parent, committed)
    bad: list[str] = []

    def of(paths: Sequence[Path], read: Callable[[Path], list[Row]]) -> Iterator[list[Row]]:
        for path in paths:
            try:
                yield read(path)
            except (FileError, NotOwn) as error:
                bad.append(str(error))

    return merge_rows(of(folders, read_folder), of(files, read_rows)), bad


def lines(results: Results, rows: Sequence[Row]) -> tuple[Line, ...]:
    """Lines of the runs in these results, from the oldest row on; first what got worse, then what got better."""
    here = {c.record.settings_id for c in results.runs}
    found = group_by((row for row in rows if row.settings_id in here), lambda row: row.settings_id)
    out = [Line(k, own[-1].case, own[-1].problem, own[-1].solver, tuple(own)) for k, own in found.items()]
    return tuple(sorted(out, key=lambda k: (not k.changed, k.lost <= 0.0, -abs(k.lost), len(k.rows) == 1, k.case)))


def moments(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Each results folder with the statuses of its runs, the oldest first."""
    kinds = {**{m.kind: m for m in map(mark, ("success", "inaccurate", "wrong", "refused"))},
             "failed": Mark("★", "stopped", "failed")}  # fmt: skip
    out = []
    for name, own in group_by(rows, lambda row: row.results).items():
        ends = Counter(mark(r.status).kind for r in own)
        ((commit, _),) = Counter(r.commit for r in own).most_common(1)
        out.append({
            "results": name, "time": own[0].time, "commit": commit, "total": len(own),
            "counts": [(m, ends[kind]) for kind, m in kinds.items() if ends[kind]],
            "gate": list(Counter(gate_mark(r.gate) for r in own if r.gate).items()),
        })  # fmt: skip
    return sorted(out, key=lambda m: (m["time"], m["results"]))


def write(results: Results, site: Site) -> Page | None:
    """``history.html``; None while all results are of one commit."""
    rows, bad = gather(results)
    found, runs = lines(results, rows), moments(rows)
    if len({m["commit"] for m in runs}) < LEAST and not bad:
        return None
    shared = [line for line in found if len(line.rows) > 1]
    shown = [line for line in found if line.changed][:SHOWN]
    (site.folder / TABLE).write(table(shared), durable=False)
    return site.write(
        Page("History", "history.html", nav=True, order=60), "history.html", scripts=["assets/judgement.js"],
        lines=shown, shared=len(shared), table=TABLE, new=len(found) - len(shared),
        changed=sum(line.changed for line in found), worse=sum(line.changed and line.lost > 0.0 for line in found),
        moments=runs, commits=list(dict.fromkeys(m["commit"] for m in runs)), bad=bad, most=MOST,
        here=results.folder.resolve().name, sparkline=sparkline,
    )  # fmt: skip


def table(found: Sequence[Line]) -> str:
    """Each run that several results hold: first and last status, drift and error, and CPU time over the first's."""
    rows = []
    for line in found:
        numbers = [v[k] for v, _ in line.told for k in (0, -1)]
        ends = [f"{v:.4g}" if v == v else "" for v in (*numbers, line.values("cpu_ratio")[-1])]
        marks, gate = line.marks, [m.word for m in line.gates[-1:]]
        rows.append([line.case, str(len(line.rows)), "yes" if line.changed else "no", marks[0].word, marks[-1].word,
                     *ends, *(gate or [""])])  # fmt: skip
    return format_csv([HEADS, *rows])
