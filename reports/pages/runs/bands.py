"""False successes as cards, how long each solver follows the truth, claims as dots: bands of the first page."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ....harness.results.judgements.files import CLAIMS, PUBLISHED
from ....harness.results.records import reasons_of
from ....harness.results.reproduce import write_command
from ....harness.results.words import law_of
from ...mechanism.stage import moment
from ...model.accuracy import list_followed, margin
from ...model.catalogue import code_of_others, is_engine
from ...model.heat import Heat
from ...model.results import Results, Run, group_by, read_results
from ...model.words import number, time
from ...plots.palette import Look
from ..base import JUDGE, read_judged_or_published, read_or_why
from ..judged.claims import Shown, claims_of, counts
from ..svg import snapshot, ticks_on

CARDS = 6
ENGINES = PUBLISHED.path / "engines"  # a false success of each, for results without engines
SENTENCES = 10
DEPENDS = ("conditional", "mixed")


def false_successes(results: Results, label: str) -> tuple[list[dict[str, Any]], int]:
    """The farthest over its limit of each solver, code of others and plain settings first; how many are wrong here."""
    wrong = [c for c in results.runs if c.status == "wrong"]
    engines = any(is_engine(s) for s in results.solvers)
    published = () if engines else read_results(ENGINES).runs  # made elsewhere, with engines that these results lack

    def key(c: Run) -> tuple[bool, bool, bool, float, str]:
        m = margin(c)
        size = m.part if m and math.isfinite(m.part) else 0.0
        return not code_of_others(c.record.solver), c.record.label != label, bool(c.options), -size, c.record.run_id

    worst = [min(own, key=key) for own in group_by([*wrong, *published], lambda c: c.record.solver).values()]
    return [_card(results, c, c in published) for c in sorted(worst, key=key)[:CARDS]], len(wrong)


def _card(results: Results, run: Run, published: bool) -> dict[str, Any]:
    """A run that claims success and is wrong, when it breaks its law, drawn as late as errors are judged."""
    m, r = margin(run), run.record
    reason = m.error if m else reasons_of(r.wrong_because)[0]
    drawn = min(t for t in (r.t_reached_s, r.reference_horizon_s, r.judged_to_s) if t > 0.0)
    seen = moment(results, run, drawn) if r.series and not published else None
    words = f"{r.solver} on {run.variant} at {time(drawn)} s, over the exact motion"
    return {
        "run": run, "code": code_of_others(r.solver).partition(" on ")[0], "published": published,
        "picture": snapshot(*seen, words) if seen else None, "law": law_of(reason).removeprefix("the "),
        "size": f"{number(reason.value)} of {' '.join(filter(None, (number(reason.limit), reason.unit)))} allowed",
        "times": reason.value / reason.limit if reason.limit > 0.0 else math.inf,
        "at": reason.time_s if reason.time_s == reason.time_s else r.t_reached_s, "drawn": drawn,
        "command": write_command(r, results.plugins),
    }  # fmt: skip


def strips(picture: Heat | None, looks: Mapping[str, Look]) -> list[dict[str, Any]]:
    """How long each solver follows the exact motion, one a problem of the heat map that has a reference."""
    out = []
    for variant in picture.problems if picture else ():
        own = list_followed(variant)
        known = max((f.known for f in own), default=0.0)
        if known > 0.0:
            whole = sum(f.whole for f in own)
            dots = [(f.until / known, looks[f.run.record.solver].colour, f"{f.run.record.solver}: {f.words}",
                     f.run.record.solver) for f in own if not f.whole]  # fmt: skip
            words = f"{variant.title}: {whole} of {len(own)} to {time(float(f'{known:.3g}'))} s"
            out.append({"variant": variant, "whole": whole, "count": len(own), "known": known,
                        "picture": ticks_on(dots, whole, words)})  # fmt: skip
    return out


def verdicts(results: Results) -> dict[str, Any] | None:
    """The paper's claims as judged by these results, else as published; None where there is neither."""
    found = read_judged_or_published(results.folder, CLAIMS)
    kept = read_or_why(PUBLISHED, CLAIMS, f"{JUDGE} --publish").found or ()  # for claims that lack runs here
    shown = [c for c in claims_of(found.found or (), results.by_settings, kept) if not c.presentation]
    if not shown:
        return None
    return {"counts": {m.word: k for m, k in counts(shown)}, "columns": group_by(shown, lambda c: c.section),
            "sentences": told(shown), "published": found.published or any(c.published for c in shown)}  # fmt: skip


def told(shown: Sequence[Shown]) -> list[Shown]:
    """Ten: verdicts in turns, so that each kind is heard, in the order of the paper."""
    kinds = {w: [c for c in shown if c.mark.word == w] for w in ("refuted", "supported", *DEPENDS)}
    turns = [c for k in range(SENTENCES) for own in kinds.values() for c in own[k : k + 1]][:SENTENCES]
    return [c for c in shown if c in turns]
