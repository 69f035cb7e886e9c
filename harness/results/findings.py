"""Define a finding on a solver, a problem or a run: a measured quantity, its requirement, and the verdict."""

import math
from dataclasses import asdict, dataclass, field
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
class MeasuredQuantity:
    """A quantity with its value; ``words`` say where it was found, or stand for a value that is not one number."""

    quantity: str = ""
    value: float = math.nan
    unit: str = ""
    time_s: float = math.nan
    words: str = ""

    @property
    def text(self) -> str:
        """The value with its unit, or the words if there is no number."""
        return self.words if math.isnan(self.value) else f"{self.value:.4g} {self.unit}".rstrip()


@dataclass(frozen=True)
class RequiredLimits:
    """The limits of a value, or a requirement in words; ``why`` and ``remedy`` are shown if it fails."""

    least: float = -math.inf
    most: float = math.inf
    words: str = ""
    why: str = ""  # reason for the limits
    remedy: str = ""  # what to do about a failure

    @property
    def text(self) -> str:
        """The requirement in words: ``at most 3``, ``2 to 3``."""
        least, most = f"{self.least:.3g}", f"{self.most:.3g}"
        if self.words or not (math.isfinite(self.least) or math.isfinite(self.most)):
            return self.words
        if not math.isfinite(self.least):
            return f"at most {most}"
        if not math.isfinite(self.most):
            return f"at least {least}"
        return least if self.least == self.most else f"{least} to {most}"


@dataclass(frozen=True)
class Finding:
    """A measurement on ``subject``, its requirement, and the verdict."""

    measured: MeasuredQuantity
    required: RequiredLimits = field(default_factory=RequiredLimits)
    verdict: Verdict = Verdict.OPEN
    subject: str = ""
    cause: str = ""  # of a failure unrelated to the requirement: a run that crashed, code that raised
    before: float = math.nan  # the value when the requirement was set

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
        measured, required = asdict(self.measured), asdict(self.required)
        required["required"] = required.pop("words")
        return {"subject": self.subject, "verdict": self.verdict.name.lower(), **measured, **required}


def judge_value(
    value: float,
    unit: str = "",
    least: float = -math.inf,
    most: float = math.inf,
    words: str = "",
    *,
    good: bool = True,
    tested: bool = True,
    remedy: str = "",
    cause: str = "",
) -> Finding:
    """Return the finding on a value that must lie from ``least`` to ``most``; NaN lies outside.

    ``words`` describe the value. With ``good=False`` it fails for another reason, ``tested=False`` leaves the verdict
    open. ``remedy`` and ``cause`` are shown if it fails.
    """
    verdict = Verdict.from_outcome(good and least <= value <= most if tested else None)
    return Finding(
        MeasuredQuantity("", value, unit, words=words), RequiredLimits(least, most, remedy=remedy), verdict, cause=cause
    )


def make_failure(words: str, *, remedy: str = "", cause: str = "") -> Finding:
    """Return a finding that failed and has no number, such as a run that crashed."""
    return judge_value(math.nan, words=words, remedy=remedy, cause=cause)


def leave_open(words: str) -> Finding:
    """Return a finding on a requirement that could not be tested; ``words`` say why."""
    return judge_value(math.nan, words=words, tested=False)


def state_finding(quantity: str, words: str, required: str = "", good: bool | None = None) -> Finding:
    """Return a finding in words instead of numbers; ``good`` is whether the requirement is met.

    ``good`` is None if nothing is required or it could not be determined.
    """
    return Finding(MeasuredQuantity(quantity, words=words), RequiredLimits(words=required), Verdict.from_outcome(good))
