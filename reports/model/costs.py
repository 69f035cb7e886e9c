"""The cost of an error on each problem: solvers by CPU time at every power of ten, and why others do not get there."""

import math
import shlex
from collections.abc import Callable, Sequence
from typing import Any

from .accuracy import measure_for
from .frontier import Frontier
from .results import Results, Run, Variant, by_solver, group_by, text_of
from .words import decade, mark, number, seconds

ASKED = "1 mm"
UNITS = {"m": ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm")), "rad": ((1.0, "rad"),)}


def length(value: float, unit: str) -> str:
    """``1 mm``, ``610 µm``, ``10⁻⁴ rad``."""
    scale, name = next((u for u in UNITS.get(unit, ((1.0, unit),)) if value >= 0.999 * u[0]), (1.0, unit))
    power = math.isclose(math.log10(value), round(math.log10(value)))
    words = f"{value / scale:.3g}" if scale != 1.0 else decade(value) if power else number(value, 2)
    return f"{words} {name}"


def costs(results: Results, found: Sequence[Frontier], url: Callable[[Run], str]) -> list[dict[str, Any]]:
    """Costs of every problem in ``found``, at the errors that at least two solvers reach."""
    variants = {p.title: p for p in results.variants}
    return [_of(variants[title], own, url)
            for title, own in group_by(found, lambda f: f.variant).items()]  # fmt: skip


def _of(variant: Variant, found: Sequence[Frontier], url: Callable[[Run], str]) -> dict[str, Any]:
    measure = measure_for(variant.runs)
    unit = found[0].unit
    targets = [f.target for f in found]
    solvers = {}
    for name, runs in sorted(by_solver(variant.runs).items()):
        sound = [c for c in runs if c.status in ("success", "inaccurate") and c.record.cpu_median_s > 0.0]
        points = sorted((c.record.cpu_median_s, measure.of(c)) for c in sound) if measure else []
        points = [p for p in points if p[1] == p[1]]
        reached = {f.target: p for f in found for p in f.places if p.run.record.solver == name}
        solvers[name] = {
            "cpu": [reached[t].cpu_s if t in reached else None for t in targets],
            "bound": [t in reached and reached[t].bound for t in targets],
            "factor": [reached[t].factor if t in reached else None for t in targets],
            "shown": [seconds(reached[t].cpu_s) if t in reached else "" for t in targets],
            "url": url(next(iter(reached.values())).run if reached else runs[0]),
            "why": _why(runs, min((e for _, e in points), default=None), unit), "points": points,
        }  # fmt: skip
    return {
        "title": variant.title, "slug": variant.slug, "problem": variant.problem.replace("_", " "), "unit": unit,
        "parameters": variant.parameters, "targets": targets, "words": [length(t, unit) for t in targets],
        "command": [advise(variant, t) for t in targets], "solvers": solvers, "answers": [answer(f) for f in found],
    }  # fmt: skip


def answer(f: Frontier) -> str:
    """``rkmk_dop853 needs 9.54 ms of CPU time; 9 of 21 solvers do not get there``."""
    best, missed = f.places[0], len(f.missed) + len(f.refused)
    least = f"{best.run.record.solver} needs {'at most ' if best.bound else ''}{seconds(best.cpu_s)} of CPU time"
    return f"{least}; {missed} of {len(f.places) + missed} solvers do not get there" if missed else least


def advise(variant: Variant, target: float) -> str:
    """The command that asks the same on this machine."""
    words = ["mbsbench", "advise", variant.problem]
    for name, value in variant.runs[0].parameters.items():
        words += ["--t-end", text_of(value)] if name == "t_end" else ["--problem-set", f"{name}={text_of(value)}"]
    return shlex.join([*words, "--error", f"{target:.0e}".replace("e-0", "e-")])


def _why(runs: Sequence[Run], best: float | None, unit: str) -> str:
    """Why a solver is not in the race."""
    wrong = [c for c in runs if c.status == "wrong"]
    if best is not None:
        return f"best {length(float(f'{best:.1e}'), unit)}" if best > 0.0 else f"best 0 {unit}"
    if wrong:
        return f"{mark('wrong').symbol} reports success, is wrong"
    return mark(runs[0].status).word


def default_target(problem: dict[str, Any]) -> int:
    """A millimetre where it is compared; else the tightest error that at least half of the solvers reach."""
    if ASKED in problem["words"]:
        return int(problem["words"].index(ASKED))
    reached = [
        sum(s["cpu"][k] is not None for s in problem["solvers"].values()) for k in range(len(problem["targets"]))
    ]
    enough = [k for k, n in enumerate(reached) if 2 * n >= len(problem["solvers"])]
    return max(enough, default=0)
