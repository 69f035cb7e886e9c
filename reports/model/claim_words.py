"""What a judged claim rests on, in words: made here for the command, the pages and the captions alike."""

from collections.abc import Sequence

from ...harness.results.judgements.claims import Claim, Condition, Decision, Ending, Gap, Missing, Test, Value
from .words import listed, number, plural, unit

MOST_LISTED = 6  # combinations listed one by one
FLAGS = {
    "lambda_in_error_test": ("multipliers in the error test", "multipliers outside the error test"),
    "velocities_in_error_test": ("velocities in the error test", "velocities outside the error test"),
    "consistent_start": ("a consistent start", "a start from lambda = 0"),
}
LEFT_OUT = {
    Ending.MACHINE: "a limit on time or memory ended them, which another machine might not meet",
    Ending.UNCOMPARED: "their runs cannot be compared (two failures, no partner, equal steps, or values missing)",
    Ending.SLOW: "the limit on steps ended them while they were only slow",
    Ending.NO_STEP: "they could not take a first step",
    Ending.ENDED: "their runs get to the end, and the claim is about those that stop",
}


def measured(test: Test) -> str:
    """``0.031 J``; ``never`` for a time that does not come."""
    if test.unbounded:
        return "never" if test.unit == "s" else "unbounded"
    if test.measured != test.measured:
        return "not measured"
    count = not test.unit and test.measured.is_integer() and abs(test.measured) < 1e6
    return f"{test.measured:.0f}" if count else f"{number(test.measured)} {unit(test.unit)}".strip()


def band(test: Test) -> str:
    """``at least 0.05 m``."""
    low, high = (None if v is None else f"{v:g}" for v in test.band)
    words = f"at most {high}" if low is None else f"at least {low}" if high is None else f"{low} to {high}"
    return f"{words} {unit(test.unit)}".strip()


def metric(test: Test) -> str:
    """A column of the records goes by its own name."""
    if test.metric == "column":
        words = str(test.arguments["name"])
    else:
        given = ", ".join(f"{k} {v}" for k, v in test.arguments.items() if k != "partial")
        words = f"{test.metric} [{given}]" if given else test.metric
    compared = f" ({test.compare} of others)" if test.compare else ""
    return f"{words}{compared}{f' ({test.combine})' if test.combine else ''}"


def value(name: str, given: Value) -> str:
    """A value of a dimension: ``5``, ``a consistent start``."""
    if isinstance(given, bool):
        return FLAGS.get(name, (spaced(name), f"no {spaced(name)}"))[not given]
    if given is None:
        return f"no {spaced(name)}"
    return given if isinstance(given, str) else f"{given:g}"


def setting(name: str, given: Value) -> str:
    """The same with the dimension where it is needed: ``gain 5``."""
    alone = given is None or isinstance(given, bool) or name in ("problem", "solver", "frame")
    return value(name, given) if alone else f"{spaced(name)} {value(name, given)}"


def spaced(name: str) -> str:
    """A name with spaces for underscores."""
    return name.replace("_", " ")


def because(c: Claim) -> str:
    """Counts, conditions, settings left out and caveats, in sentences."""
    b = c.because
    out = [*b.stand_ins]
    if b.settings:
        out.append(f"holds in {b.holds} of {b.settings} settings")
        out[-1] += f", each compared across {b.across}" if b.across else ""
    if b.stopped:
        out.append(f"in {b.stopped} of these {b.holds} because a run stopped before its end")
    if b.printed:
        out.append(f"with the settings that the paper prints in {b.printed_holds} of {b.printed}")
    if b.met_at:
        each = ", ".join(f"{setting(b.across, m.value)} in {m.holds}" for m in b.met_at)
        out.append(f"one {b.across} that meets it suffices: {each}")
    if b.decision:
        out.append(decision(c, b.decision))
    left = [f"{plural(x.settings, 'setting is', 'settings are')} left out: {LEFT_OUT[x.why]}" for x in b.left_out]
    said = [s[0].upper() + s[1:] for s in (*out, *left, *c.caveats)]
    return f"{'. '.join(said)}." if said else ""


def missing(c: Claim) -> str:
    """What is missing to test the claim; empty where it was tested."""
    return "; ".join(map(_missing, c.missing))


def decision(c: Claim, d: Decision) -> str:
    """Both sides by name where they are short, else the shorter one by name and the rest as a count."""
    yes, no = ([x for x in d.conditions if bool(x.holds) is side] for side in (True, False))
    if not d.by:
        parts = [f"{word} with {_listed(some)}" for word, some in (("always", yes), ("never", no)) if some]
        if d.telling:
            counts = ", ".join(f"{setting(d.telling, f.value)} {f.holds} of {f.settings}" for f in c.factors[d.telling])
            parts.append(f"{spaced(d.telling)} matters most: {counts}")
        return "; ".join(parts) or "no dimension varies"
    short = len(d.conditions) <= MOST_LISTED
    holds = _listed(yes) if short or len(yes) <= len(no) else f"all else ({_sum(yes)})"
    fails = _listed(no) if short or len(yes) > len(no) else f"anything else ({_sum(no)})"
    decides = "decides alone" if len(d.by) == 1 else "decide together"
    return f"{' and '.join(map(spaced, d.by))} {decides}: holds with {holds}, not with {fails}"


def tried(c: Claim) -> str:
    """Of the settings that settle the claim; those left out beside it."""
    left = sum(x.settings for x in c.because.left_out)
    return f"holds in {c.because.holds} of {c.because.settings} settings{f', {left} left out' if left else ''}"


def figures(c: Claim) -> str:
    """``6 and 7``."""
    return listed([str(n) for n in c.figure])


def _listed(conditions: Sequence[Condition]) -> str:
    more = f"; and {len(conditions) - MOST_LISTED} more" if len(conditions) > MOST_LISTED else ""
    return "; ".join(map(_condition, conditions[:MOST_LISTED])) + more


def _condition(c: Condition) -> str:
    return f"{' and '.join(setting(n, v) for n, v in c.at.items())} ({c.holds} of {c.settings})"


def _sum(conditions: Sequence[Condition]) -> str:
    return f"{sum(c.holds for c in conditions)} of {sum(c.settings for c in conditions)}"


def _missing(m: Missing) -> str:
    if m.gap is Gap.RUNS:
        absent, first = m.wanted - m.found, f", first {m.name}" if m.name else ""
        return f"runs missing: {absent or 'all'} of {m.wanted} of the map {m.map}{first}"
    return {
        Gap.NEED: m.name,
        Gap.VALUES: f"the suite has {m.found} of {m.wanted} values of {m.name} for the map {m.map}",
        Gap.GROUPS: f"no two runs of the map differ in {m.name} alone",
        Gap.SETTLED: "no setting of the map settles it",
        Gap.NUMBER: f"no run of the map has the number {m.name!r}",
    }[m.gap]
