"""A finding on a solver, a problem or a run: a quantity measured, what is required of it, and the verdict."""

import math
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any


class Verdict(StrEnum):
    """Whether a requirement is met."""

    MET = "ok"
    FAILED = "FAIL"
    OPEN = "-"  # nothing is required, or nothing could be tested
    XFAIL = "XFAIL"  # expected to fail, and did
    XPASS = "XPASS"  # expected to fail, and did not: the expectation is out of date

    @classmethod
    def of(cls, good: bool | None) -> "Verdict":
        """The verdict on a requirement that is met, not met, or (None) could not be tested."""
        return cls.OPEN if good is None else cls.MET if good else cls.FAILED


@dataclass(frozen=True)
class Measured:
    """A quantity with its value; ``words`` say where it was found, or stand for a value that is no single number."""

    quantity: str = ""
    value: float = math.nan
    unit: str = ""
    time_s: float = math.nan
    words: str = ""

    @property
    def text(self) -> str:
        """The value with its unit, or the words where there is no number."""
        return self.words if math.isnan(self.value) else f"{self.value:.4g} {self.unit}".rstrip()


@dataclass(frozen=True)
class Required:
    """Limits of a value, or words; ``why`` and ``remedy`` are for whoever does not meet them."""

    least: float = -math.inf
    most: float = math.inf
    words: str = ""
    why: str = ""
    remedy: str = ""

    @property
    def text(self) -> str:
        """``at most 3``, ``2 to 3`` or the words."""
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

    measured: Measured
    required: Required = field(default_factory=Required)
    verdict: Verdict = Verdict.OPEN
    subject: str = ""
    cause: str = ""  # of a failure that has nothing to do with the requirement: a run that crashed, code that raised
    before: float = math.nan  # the value when the requirement was set

    @property
    def holds(self) -> bool:
        """Whether the requirement is met or could not be tested."""
        return self.verdict not in (Verdict.FAILED, Verdict.XPASS)

    @property
    def is_tested(self) -> bool:
        """Whether there is a verdict."""
        return self.verdict is not Verdict.OPEN

    def as_plain(self) -> dict[str, Any]:
        """One flat object for JSON."""
        measured, required = asdict(self.measured), asdict(self.required)
        required["required"] = required.pop("words")
        return {"subject": self.subject, "verdict": self.verdict.name.lower(), **measured, **required}


def compare(
    value: float, unit: str = "", least: float = -math.inf, most: float = math.inf, words: str = "",
    *, good: bool = True, tested: bool = True, remedy: str = "", cause: str = "",
) -> Finding:  # fmt: skip
    """A value against its limits; NaN is outside, and ``good`` is False where more than the value is wrong."""
    verdict = Verdict.of(good and least <= value <= most if tested else None)
    return Finding(Measured("", value, unit, words=words), Required(least, most, remedy=remedy), verdict, cause=cause)


def fail(words: str, *, remedy: str = "", cause: str = "") -> Finding:
    """A failure without a number."""
    return compare(math.nan, words=words, remedy=remedy, cause=cause)


def leave_open(words: str) -> Finding:
    """A requirement that could not be tested."""
    return compare(math.nan, words=words, tested=False)


def state(quantity: str, words: str, required: str = "", good: bool | None = None) -> Finding:
    """A finding in words; ``good`` is None where nothing is required or it could not be determined."""
    return Finding(Measured(quantity, words=words), Required(words=required), Verdict.of(good))
