"""Requirements of solvers and problems, and what was found."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Claim:
    """One requirement; those ``of_reference`` say nothing about a problem without one."""

    name: str
    why: str
    remedy: str
    holds: Callable[[Any], str | None]  # what was found instead, None when it holds
    of_reference: bool = False

    def finding(self, solver: str, found: str | None, note: str = "") -> "Finding":
        """With ``found`` it does not hold; a ``note`` says why there was nothing to test."""
        return Finding(solver, self.name, found is None, found or note, self.why, self.remedy)


@dataclass(frozen=True)
class Finding:
    """What became of a claim."""

    solver: str
    claim: str
    holds: bool
    found: str
    why: str
    remedy: str
