"""Define requirements on solvers and problems, and assign findings to them."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...results.findings import Finding, leave_open


@dataclass(frozen=True)
class Requirement:
    """A requirement with its reason and remedy; ``needs_reference`` marks those on a problem's reference only."""

    name: str
    why: str
    remedy: str
    measure: Callable[[Any], Finding]  # of the evidence: a ``Subject`` or a solver's ``Evidence``
    needs_reference: bool = False


def assign_findings(subject: str, requirements: Sequence[Requirement], found: Iterable[Finding]) -> list[Finding]:
    """Return the findings with the texts of their requirements, one each, in the same order.

    A failure with the cause of an earlier failure is left open, so that a cause is reported once. ``subject`` is the
    name of the solver or problem.
    """
    out, causes = list[Finding](), set[str]()
    for r, f in zip(requirements, found, strict=True):
        repeated = bool(f.cause) and not f.holds and f.cause in causes
        causes |= {f.cause} if not f.holds else set()
        f = leave_open("not tested: see above") if repeated else f
        out.append(replace(f, subject=subject, quantity=r.name, why=r.why, remedy=f.remedy or r.remedy))
    return out
