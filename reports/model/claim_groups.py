"""Group claims as the page and the command list them, and find the setting whose number is shown of each."""

import math
from collections.abc import Iterable

from ...harness.results.judgements.claims import ClaimVerdict, JudgedClaim, MapRow
from .claim_words import format_band, format_measured
from .results import group_by, make_natural_key
from .words import plural

CARRYING = "What abstract and conclusions say"
FIELD = "What textbooks and manuals say"
OTHERS = "What else the paper says"
CHECKS = "Checks of the set-up"  # theorems about a problem, and its presentation
GROUPS = (CARRYING, FIELD, OTHERS, CHECKS)
FIRST = (CARRYING, FIELD)  # listed without being asked for, and open on the page
OURS = " Ours: "  # before what the source of a claim does not say (docs/claims.md)


def name_group(c: JudgedClaim) -> str:
    """Return the heading under which a claim is listed, one of ``GROUPS``."""
    if c.kind == "presentation":
        return CHECKS
    return FIELD if c.register == "field" else CARRYING if c.summary else OTHERS


def order_claims(claims: Iterable[JudgedClaim]) -> list[JudgedClaim]:
    """Return the claims as they are listed: by group, the paper's by section and figure, the field's as in its file."""
    return sorted(claims, key=_rank)


def _rank(c: JudgedClaim) -> tuple[object, ...]:
    """Return the sort key of a claim."""
    place = () if c.register == "field" else (make_natural_key(c.section), c.figure)
    return (GROUPS.index(name_group(c)), *place)


def group_claims(claims: Iterable[JudgedClaim]) -> dict[str, list[JudgedClaim]]:
    """Return the claims in their order by the heading of their group; groups without claims are left out."""
    return group_by(order_claims(claims), name_group)


def split_claim(c: JudgedClaim) -> tuple[str, str]:
    """Return what a claim states, and which of its numbers are ours, from ``Ours:`` on; the latter may be empty."""
    statement, found, ours = c.claim.partition(OURS)
    return statement, f"{found.strip()} {ours}" if found else ""


def find_shown_row(c: JudgedClaim) -> MapRow | None:
    """Return the row of a claim's map that has the shown number, that of its first test; None if no row counts.

    It is a setting that the paper prints if one counts. Of equal numbers, a row that agrees with the verdict is taken
    first, then one whose series is not that of an earlier row.
    """
    asked = _list_asked(c)
    if not (c.tests and asked):
        return None
    shown = c.tests[0].measured
    same = [m for m in asked if m.measured == shown or (math.isnan(shown) and math.isnan(m.measured))]
    contrary = c.verdict is not ClaimVerdict.REPRODUCED  # what ``holds`` is in a row that disagrees with the verdict
    return min(same, key=lambda m: (m.holds is contrary, m.twin), default=None)


def find_command(c: JudgedClaim) -> str:
    """Return the command that repeats the run of the shown number, the first of several; empty without one."""
    row = find_shown_row(c)
    return row.command if row else ""


def _list_asked(c: JudgedClaim) -> list[MapRow]:
    """Return the rows that the shown number is chosen from: those that count, of these the printed ones if any."""
    counted = [m for m in c.map if m.holds is not None]
    return [m for m in counted if m.printed] or counted


def describe_shown(c: JudgedClaim) -> str:
    """Describe which numbers of a claim are shown, what is asked of them, and of which setting they are.

    ``0.41 deg (asked: at most 1.2 deg), of the printed setting that speaks most against it``. Empty if nothing was
    measured.
    """
    setting = name_shown_setting(c)
    numbers = " and ".join(f"{format_measured(t)} (asked: {format_band(t)})" for t in c.tests)
    return f"{numbers}, of {setting}" if setting else ""


def name_shown_setting(c: JudgedClaim) -> str:
    """Name the setting whose numbers are shown: ``the printed setting that speaks most against it``; empty if none."""
    row = find_shown_row(c)
    if row is None:
        return ""
    asked = _list_asked(c)
    holding, kind = sum(m.holds is True for m in asked), "printed setting" if row.printed else "setting"
    if len(asked) == 1:
        return f"the one {kind} that counts{_count_more(c, row)}"
    best = row.holds and holding < len(asked)
    why = "comes nearest to it" if not holding else "meets it best" if best else "speaks most against it"
    return f"the {kind} that {why}{_count_more(c, row)}"


def _count_more(c: JudgedClaim, row: MapRow) -> str:
    """Return words on further runs that a row's number is made from; empty if it is of one run."""
    return f", from {plural(row.more + 1, 'run')} along {c.because.across}" if row.more else ""
