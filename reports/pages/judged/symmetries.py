"""Describe judgements of symmetries in words and marks."""

from collections import Counter
from collections.abc import Sequence

from ....harness.results.judgements.runs import PLANARITY, REVERSAL, Symmetry, Unjudged
from ...model.words import Mark

TOLERABLE = "tolerable"  # a broken symmetry that does not mislead
MARKS = {  # worst first
    "broken": Mark("✗", "broken", "wrong"),
    "failed": Mark("★", "the run failed", "failed"),
    TOLERABLE: Mark("≠", "broken, not misleading", "inaccurate"),
    "undecided": Mark("○", "not decided", "refused"),
    "refused": Mark("⊘", "refused", "refused"),
    "holds": Mark("✓", "holds", "good"),
    "not applicable": Mark("–", "not applicable", "none"),
}
UNJUDGED = {
    Unjudged.BASE: "the run as it stands ended with {status}: {message}",
    Unjudged.PRESENTED: "{status}: {message}",
    Unjudged.BOUND: "no bound: one of the runs that it is measured by failed or has no end",
    Unjudged.SINGLE: "one body and one joint have no order",
    Unjudged.WAY_BACK: "{message}",
    Unjudged.END: "no end to compare",
}
MISSES = {REVERSAL: "misses the start", PLANARITY: "leaves the plane"}


def mark_symmetry(s: Symmetry) -> Mark:
    """Return the mark of the outcome of a check; a broken symmetry that does not mislead has its own."""
    return MARKS[_name_outcome(s)]


def _name_outcome(s: Symmetry) -> str:
    """Return the key of an outcome in ``MARKS``."""
    return TOLERABLE if s.verdict == "broken" and not s.contradicts else s.verdict


def summarize_outcomes(found: Sequence[Symmetry]) -> tuple[Mark, str]:
    """Return the mark of the worst outcome among the checks ``found`` of a symmetry, and how many keep it, in words.

    The words are empty if it is applicable to none.
    """
    count = Counter(map(_name_outcome, found))
    worst = next(mark for outcome, mark in MARKS.items() if count[outcome])
    tried = len(found) - count["not applicable"]
    return worst, f"{count['holds']} of {tried}" if tried else ""


def describe_symmetry(s: Symmetry) -> str:
    """Describe the difference between the ends of two runs, its bound, and how the bound is composed."""
    if s.unjudged is not None:
        return UNJUDGED.get(s.unjudged, s.unjudged.value).format(status=s.status, message=s.message or "no message")
    parts = [f"a tenth of the tolerance moves the end by {s.level:.1e} m"]
    if s.halved > 0.0:
        parts.append(f"half the step by {s.halved:.1e} m")
    parts += [f"rounding by {s.rounding:.1e} m at most", f"a change of the start grows {s.growth:.2g}-fold"]
    missed = f"{MISSES.get(s.check, 'ends elsewhere')} by {s.deviation:.1e} m"
    allowed = f"{missed} of {s.bound:.1e} m allowed"
    times = f"{s.deviation / s.bound:.3g} times the {s.bound:.1e} m allowed" if s.bound > 0.0 else "nothing allowed"
    if s.verdict == "broken":
        said = f"{missed}, {times}{_explain_tolerable(s)}"
    elif s.verdict == "undecided" and s.deviation > s.bound:
        said = f"{missed}, {times}, which is known to a tenth"
    elif s.verdict == "undecided":
        said = f"{missed}, but {s.bound:.1e} m allowed is more than the mechanism's size"
    elif s.exact is None:
        said = allowed
    elif s.exact:
        said = f"exactly: {missed}, as far as the steps are solved, {s.exact_bound:.1e} m"
    else:
        said = f"not exactly, within its error: {allowed}"
    return f"{said} ({', '.join(parts)})"


def _explain_tolerable(s: Symmetry) -> str:
    """Return the words on why a broken symmetry does not mislead; empty if it does."""
    if s.contradicts:
        return ""
    if s.deviation <= s.own_error:
        return f"; not misleading: the run as it stands errs by {s.own_error:.1e} m"
    return "; not misleading: motion, velocities and reactions are right to 1 % of their size"
