"""Requirements on solvers and problems, and the findings on them."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..results.findings import Finding, leave_open


@dataclass(frozen=True)
class Requirement:
    """One requirement; those ``of_reference`` say nothing about a problem without one."""

    name: str
    why: str
    remedy: str
    measure: Callable[[Any], Finding]
    of_reference: bool = False


def assign_findings(subject: str, requirements: Sequence[Requirement], found: Iterable[Finding]) -> list[Finding]:
    """Findings with their requirements; a failure whose cause was named before is left open: one cause, one line."""
    out, causes = list[Finding](), set[str]()
    for r, f in zip(requirements, found, strict=True):
        repeated = bool(f.cause) and not f.holds and f.cause in causes
        causes |= {f.cause} if not f.holds else set()
        f = leave_open("not tested: see above") if repeated else f
        required = replace(f.required, why=r.why, remedy=f.required.remedy or r.remedy)
        out.append(replace(f, subject=subject, measured=replace(f.measured, quantity=r.name), required=required))
    return out
