"""Put the grounds of a judged claim into words, once for the command, the pages and the captions."""

from ...harness.results.judgements import claims as judged
from .condition_words import (
    describe_choice,
    describe_condition,
    describe_decision,
    format_separation,
    format_setting,
    format_value,
    is_met_by_choice,
    spell_out,
)
from .words import join_words, number, plural, unit

__all__ = [
    "describe_decision",
    "format_separation",
    "format_setting",
    "format_value",
    "spell_out",
]  # re-exported for the pages
WHERE = ("at the paper's settings", "beyond them")
HERE = "here"  # of a claim of the field, which has no printed settings: at all that were tried
MOST_NAMED = 2  # most combinations of values that a sentence names
FACTOR = 1.5  # factor by which borderline bands are widened and narrowed (harness.judge.referee.claims.bands)
LEFT_OUT = {
    judged.Ending.MACHINE: "a limit on time or memory ended them, which another machine might not meet",
    judged.Ending.UNCOMPARED: "their runs cannot be compared "
    "(two failures, no partner, equal steps or motions, nothing that moved, or values missing)",
    judged.Ending.SLOW: "the limit on steps ended them while they were only slow",
    judged.Ending.APART: "we ended them, not their solver: a joint was open by the length of its arm",
    judged.Ending.NO_START: "they could not start: not one step of the size they may take",
    judged.Ending.START_UP: "they stopped in the first hundredth of their time, the start-up",
    judged.Ending.ENDED: "their runs do not stop by themselves by then, and the claim is about those that do",
    judged.Ending.EARLY: "their runs ended before the moment asked about",
}


def format_measured(test: judged.JudgedTest) -> str:
    """Format the measured value of a test: ``0.031 J``, or ``never`` for a time that is not reached."""
    if test.unbounded:
        return "never" if test.unit == "s" else "unbounded"
    if test.measured != test.measured:
        return "not measured"
    count = not test.unit and test.measured.is_integer() and abs(test.measured) < 1e6
    return f"{test.measured:.0f}" if count else f"{number(test.measured)} {unit(test.unit)}".strip()


def format_band(test: judged.JudgedTest) -> str:
    """Format the band that a test requires of its number: ``at least 0.05 m``."""
    low, high = (None if v is None else f"{v:g}" for v in test.band)
    words = f"at most {high}" if low is None else f"at least {low}" if high is None else f"{low} to {high}"
    return f"{words} {unit(test.unit)}".strip()


def name_metric(test: judged.JudgedTest) -> str:
    """Name the quantity that a test measures, with its arguments and the runs it is compared with.

    A column of the records keeps its own name.
    """
    if test.metric == "column":
        words = str(test.arguments["name"])
    else:
        given = ", ".join(f"{k} {v}" for k, v in test.arguments.items() if k != "partial")
        words = f"{test.metric} [{given}]" if given else test.metric
    rival = f", here {test.rival}" if test.rival else ""
    compared = f" ({test.compare} of others{rival})" if test.compare else ""
    return f"{words}{compared}{f' ({test.combine})' if test.combine else ''}"


def explain_verdicts(c: judged.JudgedClaim) -> str:
    """Explain a claim's verdicts in sentences: counts, conditions and caveats, at the paper's settings and beyond."""
    b = c.because
    only = "no setting of {} is judged: the verdicts say nothing of {}"
    names = join_words(list(b.unjudged))
    unjudged = [only.format(names, "it" if len(b.unjudged) == 1 else "them")] if b.unjudged else []
    out = [*b.stand_ins, *unjudged, *(s for where, f in list_sides(c) for s in _describe_finding(c, where, f))]
    if b.across and c.findings:
        out.append(f"each setting is compared across {b.across}")
    if b.met_at:
        each = ", ".join(f"{format_setting(b.across, m.value)} in {m.holds}" for m in b.met_at)
        out.append(f"one {b.across} that meets it suffices: {each}")
    said = [s[0].upper() + s[1:] for s in (*out, *c.caveats)]
    return f"{'. '.join(said)}." if said else ""


def list_sides(c: judged.JudgedClaim) -> tuple[tuple[str, judged.ClaimFinding], ...]:
    """Return the findings that exist, each with words on its settings: at the paper's settings, or beyond them.

    A claim of the field has one finding, on all settings tried.
    """
    where = WHERE if c.register == "paper" else (HERE, HERE)
    return tuple((words, f) for words, f in zip(where, (c.paper, c.beyond), strict=True) if f)


def describe_origin(c: judged.JudgedClaim) -> str:
    """Describe where a claim stands: section, figures and words of the paper, or a source and what it states."""
    if c.register == "field":
        return f"{c.section}: {c.quote}"
    figures = f", Fig. {join_figures(c)}" if c.figure else ""
    return f"the paper{f', Sect. {c.section}' if c.section[:1].isdigit() else ''}{figures}: “{c.quote}”"


def describe_verdict(c: judged.JudgedClaim) -> str:
    """Return both verdicts of a claim, and for how many of the settings tried it holds, as one sentence.

    If combinations of values suffice, the first ``MOST_NAMED`` are named. Without verdicts it says what is missing.
    """
    parts = ((where, (format_verdict(f, MOST_NAMED), format_share(f))) for where, f in list_sides(c))
    sides = (f"{where} {', '.join(filter(None, words))}" for where, words in parts)
    words = "; ".join(sides) or f"{c.verdict}: {describe_missing(c)}"
    return f"{words[0].upper()}{words[1:]}."


def format_verdict(f: judged.ClaimFinding, most: int | None = None) -> str:
    """Format a verdict with its condition or reason: ``reproduced if gain 5``, ``cannot be told, because ...``.

    If combinations of values suffice, the first ``most`` are named, or without ``most`` all.
    """
    if f.verdict is judged.ClaimVerdict.CANNOT_BE_TOLD and f.missing:
        return f"{f.verdict}, because {_describe_gap(f.missing[0])}"
    if f.verdict is judged.ClaimVerdict.CANNOT_BE_TOLD and f.left_out:
        why = (f"{plural(x.settings, 'setting')}: {LEFT_OUT[x.why]}" for x in f.left_out)
        return f"{f.verdict}, because no setting counts ({'; '.join(why)})"
    if f.verdict is judged.ClaimVerdict.REPRODUCED_IF and f.decision:
        return describe_choice(f.decision) if is_met_by_choice(f) else describe_condition(f.decision, most)
    if f.verdict is judged.ClaimVerdict.REPRODUCED and f.decision:
        return f"{f.verdict}: there are such {describe_condition(f.decision, most).removeprefix('reproduced ')}"
    return str(f.verdict)


def format_condition(f: judged.ClaimFinding) -> str:
    """Return the part of the verdict after its first words, ``direction translation``; empty if there is none."""
    return format_verdict(f).removeprefix(str(f.verdict)).lstrip(" ,:")


def describe_control(c: judged.JudgedClaim) -> str:
    """Describe whether the control, other solvers in the same settings, meets the claim too; empty without one.

    ``rk45_strong_form, in the same chart, ... does so too (...), in 4 settings where the claim holds: ...``
    """
    if c.control is None:
        return ""
    who = join_words(list(c.control.solvers))
    f = c.control.finding
    at = f"over the same {c.because.across}s" if c.because.across else "at the same tolerance"
    beside = f"{who}, in the same chart, {at}, with the same step limit and on the same motion,"
    if f.verdict is judged.ClaimVerdict.CANNOT_BE_TOLD:
        return f"{beside} settles nothing{_describe_unknown_control(c)}"
    if not f.holds:
        return f"{beside} does not ({quantify(f)}){_describe_unknown_control(c)}"
    found = f"{beside} does so too ({quantify(f)}{_format_met(f)})"
    if not c.control.both:
        return f"{found}, but in no setting where the claim holds{_describe_unknown_control(c)}"
    where = f"in {plural(c.control.both, 'setting')} where the claim holds"
    return f"{found}, {where}: there the claim does not distinguish its solvers{_describe_unknown_control(c)}"


def _describe_unknown_control(c: judged.JudgedClaim) -> str:
    """Describe the settings where the claim holds and the control is unknown, and why; empty if there are none."""
    if c.control is None or not c.control.alone:
        return ""
    why = "; ".join(LEFT_OUT[x.why] for x in c.control.finding.left_out) or "it was not run there"
    return f"; beside {plural(c.control.alone, 'setting')} where the claim holds nothing is known of it ({why})"


def format_by_solver(c: judged.JudgedClaim) -> str:
    """Format the verdict of each solver: ``by ida_index1 reproduced, for all 4 tried; ...``; empty for one solver.

    Verdicts at the paper's settings come first, then those beyond them.
    """
    printed, beyond = (
        "; ".join(f"by {n} {', '.join(filter(None, (format_verdict(f), format_share(f))))}" for n, f in side.items())
        for side in (c.by_solver, c.by_solver_beyond)
    )
    return "; ".join(filter(None, (printed, f"beyond them {beyond}" if beyond else "")))


def format_condition_and_share(f: judged.ClaimFinding) -> str:
    """Format the condition under which a claim holds, and for how many of the settings tried."""
    return "; ".join(filter(None, (format_condition(f), format_share(f))))


def format_share(f: judged.ClaimFinding | None) -> str:
    """Format how many settings hold: ``for 39 of 76 tried``, ``at 3 of 81 values``, with borderline verdicts."""
    if f is None or not f.settings:
        return ""
    flips = dict.fromkeys(f"{m.verdict}, {m.holds} of {m.settings}" for m in f.borderline)
    return f"for {quantify(f)}{_format_met(f)}" + (f" (borderline: {'; '.join(flips)})" if flips else "")


def _format_met(f: judged.ClaimFinding) -> str:
    """Format at how many values of a dimension the claim is met, if one value suffices; else return an empty string."""
    return f", at {f.met[0]} of {f.met[1]} values" if f.met else ""


def quantify(f: judged.ClaimFinding) -> str:
    """Format the count: ``all 4 tried``, ``none of 34 tried``, ``39 of 76 tried``."""
    if f.holds == f.settings:
        return "the one tried" if f.settings == 1 else f"all {f.settings} tried"
    return f"{f.holds or 'none'} of {f.settings} tried"


def format_distinct(f: judged.ClaimFinding) -> str:
    """Format ``4 distinct of 72``; the number alone if all are distinct."""
    return f"{f.settings} distinct of {f.rows}" if f.rows > f.settings else str(f.settings)


def _describe_finding(c: judged.JudgedClaim, where: str, f: judged.ClaimFinding) -> list[str]:
    """Return clauses on a verdict: counts, what is missing, failed runs, the condition, borderline bands, left out.

    ``where`` names its settings: one of ``WHERE``, or ``HERE``.
    """
    out = []
    if f.settings:
        words = f"{where} it holds for {quantify(f)}"
        words += f" ({format_distinct(f)})" if f.rows > f.settings else ""
        words += f", {plural(f.like, 'setting')} beyond them with the series of one counted with it" if f.like else ""
        words += f", met at {f.met[0]} of {plural(f.met[1], spell_out(c.because.across))}" if f.met else ""
        out.append(words)
    out += map(_describe_gap, f.missing)
    if f.lone:
        out.append(f"{plural(f.lone, 'setting')} that one failed run alone meets counted as not met {where}")
    if f.stopped:
        out.append(f"in {f.stopped} of these {f.holds} because a run stopped before its end")
    if f.decision:
        all_at = (
            f"every setting meets it at {format_separation(f.decision)}, and each at others"
            if is_met_by_choice(f)
            else ""
        )
        words = all_at or describe_decision(f.decision)
        out.append(f"{words} (settings of equal series counted each)" if f.rows > f.settings else words)
    for m in f.borderline:
        said = (
            f"with a band {FACTOR} times {m.by} ({name_metric(c.tests[m.test])}) it holds for {m.holds} of {m.settings}"
        )
        out.append(f"borderline: {said}")
    return out + [
        f"{plural(x.settings, 'setting is', 'settings are')} left out {where}: {LEFT_OUT[x.why]}" for x in f.left_out
    ]


def describe_missing(c: judged.JudgedClaim) -> str:
    """Describe what is missing to test the claim; empty if it was tested."""
    return "; ".join(map(_describe_gap, c.missing))


def describe_count(c: judged.JudgedClaim) -> str:
    """Describe how many settings hold and how many are left out of the count."""
    left = sum(x.settings for f in c.findings for x in f.left_out)
    holds, settings = sum(f.holds for f in c.findings), sum(f.settings for f in c.findings)
    return f"holds in {holds} of {settings} settings{f', {left} left out' if left else ''}"


def list_rows(c: judged.JudgedClaim, most: int | None = None) -> list[str]:
    """List one line per setting: printed or not, holds or not, its number and the control's, a command to repeat it.

    Settings that the paper prints come first, then those that hold; at most ``most`` are listed.
    """
    order = {True: 0, False: 1, None: 2}
    rows = sorted(c.map, key=lambda m: (not m.printed, order[m.holds]))
    return [_describe_row(c, m) for m in rows[:most]]


def _describe_row(c: judged.JudgedClaim, m: judged.MapRow) -> str:
    """Describe one setting of the map in a line, see ``list_rows``."""
    holds = {True: "holds", False: "does not hold", None: "open"}[m.holds]
    first = c.tests[0].unit if c.tests else ""
    measured = "no number" if m.measured != m.measured else f"{number(m.measured)} {unit(first)}".strip()
    control = f", control {number(m.control)}" if m.control == m.control else ""
    more = f", with {plural(m.more, 'run')} more along {c.because.across}" if m.more else ""
    where = "printed" if m.printed else "beyond"
    return f"{where}, {holds}: {measured}{control}, {m.status}{more}: {m.command or m.case}"


def join_figures(c: judged.JudgedClaim) -> str:
    """Join the claim's figure numbers: ``6 and 7``."""
    return join_words([str(n) for n in c.figure])


def _describe_gap(m: judged.MissingReason) -> str:
    """Describe one reason why a claim cannot be tested."""
    if m.gap is judged.ClaimGap.RUNS:
        absent, first = m.wanted - m.found, f", first {m.name}" if m.name else ""
        return f"runs missing: {absent or 'all'} of {m.wanted} of the map {m.map}{first}"
    return {
        judged.ClaimGap.NEED: m.name,
        judged.ClaimGap.VALUES: f"the suite has {m.found} of {m.wanted} values of {m.name} for the map {m.map}",
        judged.ClaimGap.GROUPS: f"no two runs of the map differ in {m.name} alone",
        judged.ClaimGap.SETTLED: "no setting of the map settles it",
        judged.ClaimGap.NUMBER: f"no run of the map has the number {m.name!r}",
        judged.ClaimGap.REACHED: (
            f"{m.found} of {m.wanted} settings got to the moment asked about: too few for a verdict"
        ),
        judged.ClaimGap.HANGS: f"the verdict hangs on one run that failed, {m.name}: no verdict",
    }[m.gap]
