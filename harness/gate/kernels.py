"""Timings of kernels as ratios to a calibration kernel of the same run, so that machines and their load may differ.

``make bench-kernels`` leaves pytest-benchmark's file in ``results/local/kernels/``; the committed baseline is such a
file with what is compared, and no more.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..results import store
from ..results.environment import ROOT

LOCAL = store.LOCAL / "kernels"
BASELINE = ROOT / "results" / "baselines" / "kernels.json"
CALIBRATION = "calibration"  # in the name of the kernel the others are divided by


class TimingError(ValueError):
    """A file of timings that cannot be used; one line."""


@dataclass(frozen=True)
class Timing:
    """One kernel, before and after, in units of the calibration kernel; NaN where it was not measured."""

    kernel: str
    before: float
    after: float

    @property
    def factor(self) -> float:
        """How many times longer it takes now."""
        return self.after / self.before

    def is_slower(self, limit: float) -> bool:
        """By more than ``limit``, or no longer measured."""
        return not math.isnan(self.before) and not self.factor <= limit


def compared(before: Path, after: Path) -> list[Timing]:
    """Every kernel of either file, the slowest change first."""
    a, b = ratios(before), ratios(after)
    both = [Timing(k, a.get(k, math.nan), b.get(k, math.nan)) for k in {**a, **b}]
    return sorted(both, key=lambda t: (-t.factor if not math.isnan(t.factor) else -math.inf, t.kernel))


def newest(folder: Path = LOCAL) -> Path:
    """The last timings taken here."""
    found = sorted(folder.glob("*.json"))
    if not found:
        raise TimingError(f"no timings in {folder}: take some with make bench-kernels")
    return found[-1]


def trimmed(path: Path) -> str:
    """The text of a baseline: least times, rounds, machine and commit of a file of timings."""
    ratios(path)  # it is one
    plain = json.loads(path.read_text(encoding="utf-8"))
    kept = [
        {"fullname": _name(b), "stats": {"min": b["stats"]["min"], "rounds": b["stats"].get("rounds", 0)}}
        for b in plain["benchmarks"]
    ]
    machine = (plain.get("machine_info") or {}).get("cpu") or {}
    words = {
        "datetime": str(plain.get("datetime", "")),
        "commit": str((plain.get("commit_info") or {}).get("id", "")),
        "processor": str(machine.get("brand_raw", "")),
    }
    return json.dumps({**words, "benchmarks": kept}, indent=1) + "\n"


def ratios(path: Path) -> dict[str, float]:
    """Least time of each kernel over least time of the calibration kernel, from pytest-benchmark's JSON."""
    try:
        plain = json.loads(path.read_text(encoding="utf-8"))
        least = {_name(b): float(b["stats"]["min"]) for b in plain["benchmarks"]}
    except OSError as error:
        raise TimingError(f"cannot read timings {path}: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        raise TimingError(f"{path} is not a file of pytest-benchmark (--benchmark-json FILE)") from None
    if not all(0.0 < t < math.inf for t in least.values()):
        raise TimingError(f"{path}: a time is not a number > 0")
    calibration = [t for name, t in least.items() if CALIBRATION in name]
    if len(calibration) != 1:
        raise TimingError(f"{path}: expected one kernel with {CALIBRATION!r} in its name (found {len(calibration)})")
    kernels = {name: t / calibration[0] for name, t in least.items() if CALIBRATION not in name}
    if not kernels:
        raise TimingError(f"{path} holds no kernel but the calibration")
    return kernels


def _name(benchmark: dict[str, Any]) -> str:
    return str(benchmark.get("fullname") or benchmark["name"])
