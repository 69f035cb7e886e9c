"""False successes as cards, how long each solver follows the truth, claims as dots: bands of the first page."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from ....harness.results.judgements.files import CLAIMS, PUBLISHED
from ....harness.results.records import reasons_of
from ....harness.results.reproduce import write_command
from ....harness.results.words import law_of
from ...mechanism.stage import moment
from ...model.accuracy import list_followed, margin
from ...model.catalogue import code_of_others, is_engine
from ...model.heat import Heat
from ...model.results import Results, Run, Variant, group_by, read_results
from ...model.words import join_words, number, plural, time
from ...plots.palette import Look
from ..judged.claims import Shown, claims_of, counts
from ..judgement import JUDGE, links_of, read_judged_or_published, read_or_why
from ..svg import snapshot, ticks_on

CARDS = 6
ENGINES = PUBLISHED.path / "engines"  # a false success of each, for results without engines
SENTENCES = 10
DEPENDS = ("conditional", "mixed")


@dataclass(frozen=True)
class FalseSuccess:
    """A run that claims success and is wrong, at the moment it breaks its law."""

    run: Run
    code: str  # the package of others that it runs
    published: bool  # made elsewhere, with engines that these results lack
    picture: Markup | None
    law: str
    size: str
    times: float
    at: float  # [s] it first passes the limit
    drawn: float  # [s] of the picture: as late as errors are judged
    command: str


def false_successes(results: Results, label: str) -> tuple[list[FalseSuccess], int]:
    """The farthest over its limit of each solver, code of others and plain settings first; how many are wrong here."""
    wrong = [c for c in results.runs if c.status == "wrong"]
    engines = any(is_engine(s) for s in results.solvers)
    published = () if engines else read_results(ENGINES).runs
    plugins = [str(p) for p in results.environment.get("plugins") or []]

    def key(c: Run) -> tuple[bool, bool, bool, float, str]:
        m = margin(c)
        size = m.part if m and math.isfinite(m.part) else 0.0
        return not code_of_others(c.record.solver), c.record.label != label, bool(c.options), -size, c.record.run_id

    worst = [min(own, key=key) for own in group_by([*wrong, *published], lambda c: c.record.solver).values()]
    return [_card(results, c, plugins, c in published) for c in sorted(worst, key=key)[:CARDS]], len(wrong)


def wrong_title(cards: Sequence[FalseSuccess], wrong: int) -> str:
    """How many runs, and which code of others is among them, here or as published."""
    verbs = "reports success and is" if wrong == 1 else "report success and are"
    said = f"{plural(wrong, 'run')} {verbs} wrong"
    here, elsewhere = (list(dict.fromkeys(c.code for c in cards if c.code and c.published is p)) for p in (False, True))
    by = f", among them {join_words(here)} at some settings" if here else ""
    return f"{said}{by}{f'; as published, also runs of {join_words(elsewhere)}' if elsewhere else ''}"


def _card(results: Results, run: Run, plugins: Sequence[str], published: bool) -> FalseSuccess:
    m = margin(run)
    reason = m.error if m else reasons_of(run.record.wrong_because)[0]
    at = reason.time_s if reason.time_s == reason.time_s else run.record.t_reached_s
    r = run.record
    drawn = min(t for t in (r.t_reached_s, r.reference_horizon_s, r.judged_to_s) if t > 0.0)
    seen = moment(results, run, drawn) if r.series and not published else None
    words = f"{r.solver} on {run.variant} at {time(drawn)} s, over the exact motion"
    size = f"{number(reason.value)} of {' '.join(filter(None, (number(reason.limit), reason.unit)))} allowed"
    times = reason.value / reason.limit if reason.limit > 0.0 else math.inf
    code, picture = code_of_others(r.solver).partition(" on ")[0], snapshot(*seen, words) if seen else None
    return FalseSuccess(run, code, published, picture, law_of(reason).removeprefix("the "), size,
                        times, at, drawn, write_command(run.record, plugins))  # fmt: skip


@dataclass(frozen=True)
class Strip:
    """How long each solver follows the exact motion of a problem."""

    variant: Variant
    whole: int  # solvers that follow it to the end of what is known
    count: int
    known: float  # [s]
    picture: Markup

    @property
    def all_follow(self) -> bool:
        return self.whole == self.count


def strips(picture: Heat | None, looks: Mapping[str, Look]) -> list[Strip]:
    """One a problem of the heat map that has a reference."""
    out = []
    for variant in picture.problems if picture else ():
        own = list_followed(variant)
        known = max((f.known for f in own), default=0.0)
        if known > 0.0:
            whole = [f for f in own if f.whole]
            dots = [(f.until / known, looks[f.run.record.solver].colour, f"{f.run.record.solver}: {f.words}",
                     f.run.record.solver) for f in own if not f.whole]  # fmt: skip
            words = f"{variant.title}: {len(whole)} of {len(own)} to {time(float(f'{known:.3g}'))} s"
            out.append(Strip(variant, len(whole), len(own), known, ticks_on(dots, len(whole), words)))
    return out


def strips_title(found: Sequence[Strip]) -> str:
    """Pairs of a solver and a motion."""
    whole, count = (sum(getattr(s, k) for s in found) for k in ("whole", "count"))
    return f"{whole} of {plural(count, 'run')} follow{'s' if count == 1 else ''} the exact motion to its end"


@dataclass(frozen=True)
class Verdicts:
    """The paper's claims on the first page."""

    title: str
    columns: dict[str, list[Shown]]
    sentences: list[Shown]
    published: str


def verdicts(results: Results) -> Verdicts | None:
    """Verdicts of these results, else as published; None where there is neither."""
    found = read_judged_or_published(results.folder, CLAIMS)
    kept = read_or_why(PUBLISHED, CLAIMS, f"{JUDGE} --publish").found or ()  # for claims that lack runs here
    shown = [c for c in claims_of(found.found or (), links_of(results.runs), kept) if not c.presentation]
    if not shown:
        return None
    n = {m.word: k for m, k in counts(shown)}
    depend = sum(n[w] for w in DEPENDS)
    title = (f"Of the claims of Natsiavas et al. (2022) {n['supported']} hold, {n['refuted']} do not, "
             f"{depend} depend on settings; {n['untestable']} cannot be tested")  # fmt: skip
    lacking = sum(c.published for c in shown)
    words = f"{lacking} lack runs here" if lacking else ""
    return Verdicts(title, group_by(shown, lambda c: c.section), told(shown), found.published or words)


def told(shown: Sequence[Shown]) -> list[Shown]:
    """Ten: verdicts in turns, so that each kind is heard, in the order of the paper."""
    kinds = {w: [c for c in shown if c.mark.word == w] for w in ("refuted", "supported", *DEPENDS)}
    turns = [c for k in range(SENTENCES) for own in kinds.values() for c in own[k : k + 1]][:SENTENCES]
    return [c for c in shown if c in turns]
