"""Define a finding on a solver, a problem or a run: a measured quantity, its requirement, and the verdict.

A finding knows how much was measured: with nothing measured, no requirement can be met, and the verdict is open.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Verdict(StrEnum):
    """A verdict on a requirement."""

    MET = "ok"
    FAILED = "FAIL"
    OPEN = "-"  # nothing is required, or nothing could be tested
    XFAIL = "XFAIL"  # expected to fail, and did
    XPASS = "XPASS"  # expected to fail, and did not: the expectation is out of date

    @classmethod
    def from_outcome(cls, good: bool | None) -> "Verdict":
        """Return the verdict on a requirement that is met, not met, or (None) could not be tested."""
        return cls.OPEN if good is None else cls.MET if good else cls.FAILED


@dataclass(frozen=True)
class Finding:
    """A quantity measured on ``subject``, its limits, and the verdict; ``words`` stand for what is not one number."""

    quantity: str = ""
    value: float = math.nan
    unit: str = ""
    words: str = ""  # where the value was found, or what was found if it is not one number
    count: int = 1  # values or runs that were measured; 0: nothing
    least: float = -math.inf
    most: float = math.inf
    required: str = ""  # the requirement in words, in place of limits
    verdict: Verdict = Verdict.OPEN
    subject: str = ""
    why: str = ""  # reason for the limits, shown with a failure
    remedy: str = ""  # what to do about a failure
    cause: str = ""  # of a failure unrelated to the requirement: a run that crashed, code that raised
    before: float = math.nan  # the value when the requirement was set

    def __post_init__(self) -> None:
        """Raise ValueError if a requirement is met although nothing was measured."""
        if not self.count and self.verdict in (Verdict.MET, Verdict.XPASS):
            raise ValueError(f"{self.quantity or 'finding'}: nothing was measured, so nothing can be met")

    @property
    def text(self) -> str:
        """The value with its unit, or the words if there is no number."""
        return self.words if math.isnan(self.value) else f"{self.value:.4g} {self.unit}".rstrip()

    @property
    def limits(self) -> str:
        """The requirement in words: ``at most 3``, ``2 to 3``."""
        least, most = f"{self.least:.3g}", f"{self.most:.3g}"
        if self.required or not (math.isfinite(self.least) or math.isfinite(self.most)):
            return self.required
        if not math.isfinite(self.least):
            return f"at most {most}"
        if not math.isfinite(self.most):
            return f"at least {least}"
        return least if self.least == self.most else f"{least} to {most}"

    @property
    def holds(self) -> bool:
        """True unless the requirement failed, or an expected failure did not occur."""
        return self.verdict not in (Verdict.FAILED, Verdict.XPASS)

    @property
    def is_tested(self) -> bool:
        """True if there is a verdict: something is required and was tested."""
        return self.verdict is not Verdict.OPEN

    def as_plain(self) -> dict[str, Any]:
        """Return the finding as a flat dict for JSON, without cause and earlier value."""
        plain = {k: v for k, v in vars(self).items() if k not in ("cause", "before")}
        return {**plain, "verdict": self.verdict.name.lower()}


def judge_value(
    value: float,
    unit: str = "",
    least: float = -math.inf,
    most: float = math.inf,
    words: str = "",
    *,
    quantity: str = "",
    good: bool = True,
    count: int = 1,
    tested: bool = True,
    remedy: str = "",
    cause: str = "",
) -> Finding:
    """Return the finding on a value that must lie from ``least`` to ``most``; NaN lies outside.

    ``words`` describe the value, ``count`` is the number of values measured. With ``good=False`` the finding fails
    whatever the value; ``tested=False`` leaves the verdict open, as does a ``count`` of 0. ``remedy`` and ``cause`` are
    shown if it fails.
    """
    verdict = Verdict.from_outcome(good and least <= value <= most if tested and count else None)
    return Finding(quantity, value, unit, words, count, least, most, verdict=verdict, remedy=remedy, cause=cause)


def make_failure(words: str, *, remedy: str = "", cause: str = "") -> Finding:
    """Return a finding that failed and has no number, such as a run that crashed."""
    return judge_value(math.nan, words=words, remedy=remedy, cause=cause)


def leave_open(words: str) -> Finding:
    """Return a finding on a requirement that could not be tested; ``words`` say why."""
    return judge_value(math.nan, words=words, count=0)


def leave_undetermined(quantity: str, why: str, required: str = "") -> Finding:
    """Return the finding on a quantity of which nothing was measured, and ``why``."""
    return Finding(quantity, words=f"not determined: {why}", count=0, required=required)


def count_holding(quantity: str, held: int, judged: int, words: str, required: str) -> Finding:
    """Return the finding that ``held`` of the ``judged`` checks hold; ``words`` describe those left out, if any.

    It is met if all hold, else open, since a check that fails has a finding of its own. If no check was judged, the
    finding is "not determined", with ``words`` as the reason.
    """
    if not judged:
        return leave_undetermined(quantity, words, required)
    counted = "; ".join(filter(None, (f"{held} of {judged} hold", words)))
    verdict = Verdict.from_outcome(True if held == judged else None)
    return Finding(quantity, words=counted, count=judged, required=required, verdict=verdict)


def state_finding(quantity: str, words: str, required: str = "", good: bool | None = None) -> Finding:
    """Return a finding in words instead of numbers; ``good`` is whether the requirement is met.

    ``good`` is None if nothing is required or it could not be determined.
    """
    return Finding(quantity, words=words, required=required, verdict=Verdict.from_outcome(good))
