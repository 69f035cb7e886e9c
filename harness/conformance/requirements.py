"""Requirements on solvers and problems, what is measured for them, and what becomes of them."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True)
class Measured:
    """A number and where it must lie; ``words`` say where it was found, or why there is none."""

    value: float = math.nan
    unit: str = ""
    least: float = -math.inf
    most: float = math.inf
    words: str = ""
    good: bool = True  # False where the number alone does not show what is wrong
    tested: bool = True  # False where there was nothing to test
    remedy: str = ""  # instead of the requirement's, where the cause is known
    cause: str = ""  # of a failure that has nothing to do with the requirement: runs that crashed, code that raised

    @property
    def holds(self) -> bool:
        """Within its limits, or not tested; NaN is outside."""
        return not self.tested or (self.good and self.least <= self.value <= self.most)


@dataclass(frozen=True)
class Requirement:
    """One requirement; those ``of_reference`` say nothing about a problem without one."""

    name: str
    why: str
    remedy: str
    measure: Callable[[Any], Measured]
    of_reference: bool = False


def said_once(found: Iterable[Measured]) -> list[Measured]:
    """What fails for a cause that was named before is not tested: one cause, one line."""
    out, causes = list[Measured](), set[str]()
    for m in found:
        again = bool(m.cause) and not m.holds and m.cause in causes
        out.append(replace(m, tested=False, words="not tested: see above", remedy="") if again else m)
        causes |= {m.cause} - {""} if not m.holds else set()
    return out


@dataclass(frozen=True)
class Finding:
    """What was measured for a requirement on the solver or problem ``entry``."""

    entry: str
    requirement: Requirement
    measured: Measured

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        r, m = self.requirement, self.measured
        return {
            "entry": self.entry,
            "requirement": r.name,
            "holds": m.holds,
            **vars(m),
            "why": r.why,
            "remedy": m.remedy or r.remedy,
        }
