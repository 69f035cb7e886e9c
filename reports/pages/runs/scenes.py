"""The mechanisms on stage: of each problem the cheapest accurate run, the paper's and the worst."""

import math
from typing import Any

from ....harness.results.records import reasons_of
from ....harness.results.words import law_of
from ...mechanism.stage import stage
from ...model.accuracy import margin, measure_for
from ...model.catalogue import code_of_others
from ...model.frontier import of_most_problems
from ...model.heat import Heat, boxes_of, rank
from ...model.results import Results, Run, Variant, group_by
from ...model.words import mark, number
from ..base import Site

MINIATURES = 6
PAPER = "ODE-GC"  # the paper's method; what is added to it has a longer label
SMALL = 60  # pictures of a miniature


def one_a_problem(picture: Heat | None, label: str) -> list[Variant]:
    """Choose the variant with a wrong run, else with most runs, of each problem of the heat map; most telling first."""

    def telling(variant: Variant) -> tuple[int, int, int]:
        """How many solvers are wrong on it in the plain comparison, and in all; how many runs it has."""
        wrong = [c for c in variant.runs if c.status == "wrong"]
        plain = {c.record.solver for c in wrong if c.record.label == label}
        return len(plain), len({c.record.solver for c in wrong}), len(variant.runs)

    found = group_by(picture.problems if picture else (), lambda p: p.problem)
    best = [max(own, key=telling) for own in found.values()]
    return sorted(best, key=telling, reverse=True)[:MINIATURES]


def roles_of(variant: Variant, label: str, site: Site) -> list[tuple[Run, str]]:
    """The cheapest accurate run, the paper's method, the worst one that claims success or, without one, the worst."""
    best_first = [b.run for b in rank(boxes_of(variant, label))]
    cheapest = _cheapest_first(variant, site) or best_first
    paper = sorted((c for c in best_first if c.record.paper_label.startswith(PAPER) and c.succeeded),
                   key=lambda c: len(c.record.paper_label))  # fmt: skip
    sizes = {c.record.run_id: min(m.part, 1e9) if (m := margin(c)) else 0.0 for c in variant.runs}
    worst = sorted(
        (c for c in variant.runs if c.status == "wrong"), reverse=True,  # implicit methods, which most codes in use are
        key=lambda c: (site.looks[c.record.solver].family == "implicit", sizes[c.record.run_id], c.record.run_id),
    ) or best_first[1:][-1:]  # fmt: skip
    out: dict[str, tuple[Run, str]] = {}
    for runs, words in ((cheapest, "cheapest accurate"), (paper, "the paper's"), (worst, "the worst")):
        for run in [c for c in runs if c.record.series][:1]:
            out.setdefault(run.record.run_id, (run, words))
    return list(out.values())


def _cheapest_first(variant: Variant, site: Site) -> list[Run]:
    """Successes by their solver's cost at one error, whose ladder may be over another time of the same motion."""

    def start(v: Variant) -> dict[str, Any]:
        return {name: value for name, value in v.runs[0].parameters.items() if name != "t_end"}

    same = {v.title for v in site.results.variants if v.problem == variant.problem and start(v) == start(variant)}
    found = of_most_problems([f for f in site.frontiers if f.variant in same])
    order = [p.run.record.solver for f in sorted(found, key=lambda f: -len(f.places)) for p in f.places]
    sound = [c for c in variant.runs if c.succeeded and c.record.solver in order]
    return sorted(sound, key=lambda c: (order.index(c.record.solver), c.record.cpu_median_s))


def scene_of(results: Results, site: Site, variant: Variant, label: str) -> dict[str, Any] | None:
    """A stage in ``data/stage-<slug>.js`` and what the page says beside it; None where no run kept poses."""
    roles, measure = roles_of(variant, label, site), measure_for(variant.runs)
    play = stage(results, roles, measure, site.looks)
    if play is None:
        return None
    site.bundle(f"stage-{variant.slug}", play)
    small = stage(results, roles[:1], measure, site.looks, SMALL)
    return {
        "file": f"stage-{variant.slug}", "title": variant.title, "problem": variant.problem.replace("_", " "),
        "slug": variant.slug, "said": [_describe_role(run, role, site) for run, role in roles],
        "small": small and {**small, "players": [] if small["exact"] else small["players"]},
    }  # fmt: skip


def _describe_role(run: Run, role: str, site: Site) -> dict[str, str]:
    measured, r = mark(run.status), run.record
    broken = [b for b in reasons_of(r.wrong_because) if run.status == "wrong" and math.isfinite(b.time_s)]
    first = min(broken, key=lambda b: b.time_s, default=None)
    since = f": {law_of(first)} passes its limit at {number(first.time_s)} s" if first else ""
    return {
        "solver": r.solver, "code": code_of_others(r.solver), "words": role, "step": run.step_words,
        "url": site.url(run), "claimed": r.claimed.replace("_", " "), "measured": f"{measured.word}{since}",
        "kind": measured.kind, "why": run.reasons[0] if run.reasons else "",
    }  # fmt: skip
