"""Thresholds of the gate: a committed TOML file, one entry a case and metric, each with its reason.

::

    schema = 1
    suite = "ci"
    [[threshold]]
    case = "heavy_top gc_weak_form dt=0.001"
    metric = "energy_drift_max_J"       # any numeric column of a record
    value = 2.0e-3                      # measured when the threshold was set
    upper = 2.2e-3                      # breached above; or lower = ..., breached below; or both
    unit = "J"
    reason = "deterministic, second order: doubling dt gives 4 times the value"
    expect = "pass"                     # "fail": a known breach; when it passes, that is news (XPASS)
    direction = "smaller"               # is better; said by the bounds: upper, or lower for "larger", or both

What is the same on every machine is compared exactly: ``direction = "equal"`` with ``value`` and no bounds (steps of
a fixed size). What may differ between machines only by rounding gets ``tolerance``, relative to ``value``, as well.

A run is expected to end with status "success", unless an entry without metric says otherwise:
``case``, ``status``, ``reason``.
"""

import dataclasses
import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..catalogue.options import nearest
from ..results.environment import ROOT
from ..results.records import COLUMNS
from ..types import Status

FOLDER = ROOT / "results" / "baselines"
METRICS = tuple(c.name for c in COLUMNS if c.type in (float, int))


KEYS = ("case", "metric", "value", "upper", "lower", "unit", "reason", "expect", "direction", "tolerance")
EQUAL = "equal"


class ThresholdError(ValueError):
    """A thresholds file that cannot be used; one line with the place."""


@dataclass(frozen=True)
class Threshold:
    """Bounds on one metric of one case."""

    case: str
    metric: str
    value: float
    upper: float
    lower: float
    unit: str
    reason: str
    expect: str = "pass"
    direction: str = "smaller"
    tolerance: float = 0.0  # relative, with direction "equal"

    def holds(self, measured: float) -> bool:
        """Within the bounds; a measurement that does not exist is not."""
        return self.lower <= measured <= self.upper


@dataclass(frozen=True)
class Expectation:
    """The status a case is expected to end with, where that is not success."""

    case: str
    status: Status
    reason: str


@dataclass(frozen=True)
class Thresholds:
    """All of a suite."""

    suite: str
    bounds: tuple[Threshold, ...]
    statuses: Mapping[str, Expectation]


def read_thresholds(path: Path) -> Thresholds:
    """The file, every entry checked."""
    try:
        return parse_thresholds(path.read_text(encoding="utf-8"), path)
    except (OSError, UnicodeDecodeError) as error:
        raise ThresholdError(f"cannot read thresholds {path}: {getattr(error, 'strerror', None) or error}") from None


def parse_thresholds(text: str, path: Path) -> Thresholds:
    """The text of a thresholds file; ``path`` names it in messages."""
    try:
        plain = tomllib.loads(text)
    except ValueError as error:
        raise ThresholdError(f"cannot read thresholds {path}: {error}") from None
    except RecursionError:
        raise ThresholdError(f"cannot read thresholds {path}: nested too deeply") from None
    unknown = [k for k in plain if k not in ("schema", "suite", "threshold", "status")]
    if unknown or plain.get("schema") != 1 or not isinstance(plain.get("suite"), str):
        raise ThresholdError(
            f"{path}: expected schema = 1, a suite and [[threshold]] entries (got {unknown or plain.get('schema')})"
        )
    bounds = tuple(_bound(e, f"{path}: threshold {k}") for k, e in enumerate(_tables(plain, "threshold", path), 1))
    expected = [_expectation(e, f"{path}: status {k}") for k, e in enumerate(_tables(plain, "status", path), 1)]
    keys = [(b.case, b.metric) for b in bounds]
    twice = {k for k in keys if keys.count(k) > 1}
    if twice:
        raise ThresholdError(f"{path}: {' '.join(sorted(twice)[0])} is there twice")
    return Thresholds(plain["suite"], bounds, {e.case: e for e in expected})


def write_thresholds(thresholds: Thresholds) -> str:
    """The text of a thresholds file."""
    out = ["schema = 1", f"suite = {_quoted(thresholds.suite)}"]
    for e in thresholds.statuses.values():
        out += ["", "[[status]]", *(f"{k} = {_quoted(str(v))}" for k, v in dataclasses.asdict(e).items())]
    for b in thresholds.bounds:
        out += ["", "[[threshold]]"]
        for key, value in dataclasses.asdict(b).items():
            if b.direction == EQUAL and key in ("value", "upper", "lower"):
                out += [f"value = {value!r}"] if key == "value" else []
            elif key == "tolerance":
                out += [f"tolerance = {value!r}"] if value else []
            elif key == "direction" and value == _said_by(b.upper, b.lower):
                continue
            elif isinstance(value, float):
                out += [f"{key} = {value:.4g}"] if math.isfinite(value) else []
            elif not (key == "expect" and value == "pass"):
                out.append(f"{key} = {_quoted(value)}")
    return "\n".join(out) + "\n"


def _quoted(text: str) -> str:
    """A basic string of TOML: as in JSON, but without pairs of surrogates, and with DEL escaped."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _tables(plain: dict[str, Any], key: str, path: Path) -> list[dict[str, Any]]:
    found = plain.get(key, [])
    if not isinstance(found, list) or not all(isinstance(e, dict) for e in found):
        raise ThresholdError(f"{path}: {key} must be a list of [[{key}]] tables")
    return found


def _bound(entry: dict[str, Any], place: str) -> Threshold:
    _keys(entry, KEYS, place)
    for key in ("case", "metric", "reason"):
        _text(entry, key, place)
    if entry["metric"] not in METRICS:
        raise ThresholdError(f"{place}: unknown metric {entry['metric']!r}{nearest(entry['metric'], list(METRICS))}")
    numbers = {"value": math.nan, "upper": math.inf, "lower": -math.inf, "tolerance": 0.0}
    for key in numbers:
        if key in entry:
            try:
                good = isinstance(entry[key], int | float) and not isinstance(entry[key], bool)
                numbers[key] = float(entry[key]) if good else math.nan
            except OverflowError:
                numbers[key] = math.inf
            if not math.isfinite(numbers[key]):
                raise ThresholdError(f"{place}: {key} must be a finite number (got {str(entry[key])[:40]})")
    direction = entry.get("direction", _said_by(numbers["upper"], numbers["lower"]))
    if direction == EQUAL:
        return _equal(entry, numbers, place)
    if "upper" not in entry and "lower" not in entry:
        raise ThresholdError(f"{place}: give upper or lower; without a bound nothing is checked")
    if entry.get("expect", "pass") not in ("pass", "fail"):
        raise ThresholdError(f"{place}: expect must be pass or fail (got {entry['expect']!r})")
    if direction != _said_by(numbers["upper"], numbers["lower"]) or "tolerance" in entry:
        raise ThresholdError(
            f"{place}: direction must fit the bounds: smaller with upper, larger with lower, between with both, equal "
            f"(and tolerance) with value alone (got {direction!r})"
        )
    if numbers["lower"] > numbers["upper"]:
        raise ThresholdError(f"{place}: lower is above upper: nothing could pass")
    words = (str(entry.get("unit", "")), entry["reason"], entry.get("expect", "pass"), direction)
    return Threshold(entry["case"], entry["metric"], numbers["value"], numbers["upper"], numbers["lower"], *words)


def equal(
    case: str, metric: str, value: float, unit: str, reason: str, *, tolerance: float = 0.0, expect: str = "pass"
) -> Threshold:
    """A threshold that only ``value`` itself passes, or what is within ``tolerance`` of it."""
    wide = tolerance * abs(value)
    return Threshold(case, metric, value, value + wide, value - wide, unit, reason, expect, EQUAL, tolerance)


def _equal(entry: dict[str, Any], numbers: dict[str, float], place: str) -> Threshold:
    if "value" not in entry or "upper" in entry or "lower" in entry or not 0.0 <= numbers["tolerance"] < 1.0:
        raise ThresholdError(f"{place}: direction equal takes value, and tolerance from 0 to 1, and no bounds")
    if entry.get("expect", "pass") not in ("pass", "fail"):
        raise ThresholdError(f"{place}: expect must be pass or fail (got {entry['expect']!r})")
    named = (entry["case"], entry["metric"], numbers["value"], str(entry.get("unit", "")), entry["reason"])
    return equal(*named, tolerance=numbers["tolerance"], expect=entry.get("expect", "pass"))


def _said_by(upper: float, lower: float) -> str:
    return "between" if math.isfinite(upper) and math.isfinite(lower) else "larger" if upper == math.inf else "smaller"


def _expectation(entry: dict[str, Any], place: str) -> Expectation:
    _keys(entry, ("case", "status", "reason"), place)
    for key in ("case", "status", "reason"):
        _text(entry, key, place)
    if entry["status"] not in [str(s) for s in Status]:
        raise ThresholdError(
            f"{place}: unknown status {entry['status']!r}{nearest(entry['status'], [str(s) for s in Status])}"
        )
    return Expectation(entry["case"], Status(entry["status"]), entry["reason"])


def _keys(entry: dict[str, Any], known: tuple[str, ...], place: str) -> None:
    for key in entry:
        if key not in known:
            raise ThresholdError(f"{place}: unknown key {key!r}{nearest(key, list(known))}")


def _text(entry: dict[str, Any], key: str, place: str) -> None:
    if not isinstance(entry.get(key), str) or not entry[key].strip():
        raise ThresholdError(f"{place}: {key} must be given as text (got {entry.get(key)!r})")
