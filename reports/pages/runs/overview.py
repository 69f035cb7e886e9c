"""The first page in six bands: the race over the moving mechanism, cost, heat map, false successes, claims, doors."""

from collections.abc import Sequence
from typing import Any

from ....harness.results.reproduce import write_command
from ...model.accuracy import LEVELS, Measure, measure_for
from ...model.frontier import Frontier, broad, costs, default_target, of_most_problems
from ...model.heat import Box, heat
from ...model.motion import upper
from ...model.results import Results
from ...model.scores import broadest, mechanisms, unpredictable
from ...model.words import number, seconds
from ...plots.browser import Steps
from ...plots.spec import Plot
from ..base import Page, Site
from ..judged import cost
from .bands import false_successes, strips, verdicts
from .scenes import one_a_problem

PANELS = 6
STRIP = 60  # spans of time in the energy strip of a cell
RANK = 5  # after the pages of cost, problems and solvers, whose plots, scenes and cards it shows


def write(results: Results, site: Site) -> Page | None:
    """``index.html``."""
    label, picture = broadest(results), heat(results)
    found = broad(results, site.frontiers)
    races = costs(results, found, site.url)
    stages = [site.scenes[p.title] for p in one_a_problem(picture, label) if p.title in site.scenes]
    on = stages[0] if stages else {}
    near = [k for k, r in enumerate(races) if r["problem"] == on.get("problem")]  # of them the one with most points
    first = max(near, key=lambda k: sum(len(s["points"]) for s in races[k]["solvers"].values()), default=0)
    target = default_target(races[first]) if races else 0
    problems, rows = (picture.problems, picture.rows) if picture else ((), ())
    boxes = [(row.solver, p, b) for row in rows for p, b in zip(problems, row.boxes, strict=True) if b]
    cells = {f"{solver} {p.slug}": _cell(results, site, b, measure_for(p.runs)) for solver, p, b in boxes}
    data = {"costs": races, "stages": stages, "cells": cells, "first": first, "target": target,
            "colours": {s: k.colour for s, k in site.looks.items()}}  # fmt: skip
    scripts = [site.bundle("overview", data), *(f"data/{s['file']}.js" for s in stages[:1]),
               "assets/stage.js", "assets/overview.js"]  # fmt: skip
    cards, wrong = false_successes(results, label)
    return site.write(
        Page("Overview", "index.html", nav=True, order=0), "overview.html", plots=_panels(site), scripts=scripts,
        heat=picture, levels=LEVELS, label=label, unpredictable=unpredictable(results), races=races, first=first,
        target=target, stages=stages, panels_title=panels_title(of_most_problems(found)), cards=cards,
        wrong=wrong, strips=strips(picture, site.looks), verdicts=verdicts(results), mechanisms=mechanisms(results),
        door=max(site.cards.values(), key=lambda c: (len(c["facts"]), c["solver"]), default=None),
    )  # fmt: skip


def panels_title(found: Sequence[Frontier]) -> str:
    """Who is the cheapest most often, and how much the median costs."""
    if not any(f.places for f in found):
        return "Accuracy against cost"
    factors = sorted(p.factor for f in found for p in f.places)
    return f"{cost.title(found)}; the median solver costs {number(factors[len(factors) // 2], 2)} times as much"


def _cell(results: Results, site: Site, b: Box, measure: Measure | None) -> dict[str, Any]:
    r = b.run.record
    series = results.series(b.run, poses=False) if r.series else None
    strip = None
    if series is not None and "energy_error" in series and len(series["t"]):
        curve = upper(series["t"], series["energy_error"], r.t_end_s, STRIP)
        strip = {"t": Steps(curve.t), "y": Steps(curve.y, log=True)}
    error = f"{number(measure.of(b.run))} {measure.unit}" if measure else "no reference"
    facts = (("CPU", seconds(r.cpu_median_s)), (measure.what if measure else "error", error),
             ("energy error", f"{number(r.energy_drift_max_J)} J"), ("steps", str(r.steps)))  # fmt: skip
    return {"words": b.words, "url": site.url(b.run), "kind": b.mark.kind, "command": write_command(r, results.plugins),
            "strip": strip, "facts": facts}  # fmt: skip


def _panels(site: Site) -> list[Plot]:
    """Error over CPU time: of each problem the variant with most points, then other variants."""
    problems = {p.title: p.problem for p in site.results.variants}
    ordered = sorted(site.work.items(), key=lambda kv: -sum(len(t.x) for t in kv[1].traces))
    seen: dict[str, str] = {}
    for title, _ in ordered:
        seen.setdefault(problems.get(title, title), title)
    return [plot for _, plot in sorted(ordered, key=lambda kv: kv[0] not in seen.values())][:PANELS]
