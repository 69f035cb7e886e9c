"""Specify a run: one problem, one solver, one control, with limits; checked when made, addressed by its content."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ...base.hints import format_value
from ...base.naming import format_exactly, format_name
from ...mechanics.types import Problem, StepControl
from .. import registry

DEFAULT_RTOL = 1e-8
# [s]: more lets the hopeless settings of a sweep hold a core, less ends slow runs as unfinished
DEFAULT_CPU_LIMIT = 60.0
DEFAULT_MEMORY = 4000.0  # [MB] beyond the libraries' memory


@dataclass(frozen=True)
class RunSpec:
    """The specification of a run; ``parameters`` and ``options`` hold only values that differ from the defaults."""

    problem: str
    solver: str
    control: StepControl  # without cpu_limit, which is the run's
    parameters: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    cpu_limit: float = DEFAULT_CPU_LIMIT  # [s]
    memory: float = DEFAULT_MEMORY  # [MB]
    repeats: int = 1
    min_time: float = 0.0  # [s] CPU time for which a solve of less than 20 ms is repeated
    label: str = ""

    @cached_property
    def settings_id(self) -> str:
        """The digest of all that shapes the motion except the code."""
        return _digest(self._settings())

    def address(self, code: str) -> str:
        """Return the run_id: the digest of the settings, the limits and ``code``.

        ``code`` is itself the digest of the code that the result depends on.
        """
        limits = {name: float(getattr(self, name)) for name in ("cpu_limit", "memory", "repeats", "min_time")}
        return _digest({**self._settings(), **limits, "code": code})

    @property
    def case(self) -> str:
        """The settings in words, as in ``heavy_top rattle dt=0.001``."""
        c = self.control
        steps = {"dt": c.dt, "rtol": c.rtol, "max_step": c.max_step}
        words = [f"{k}={format_exactly(v)}" for k, v in steps.items() if v is not None]
        if c.max_steps != StepControl.max_steps:
            words.append(f"max_steps={c.max_steps}")
        return " ".join([format_name(self.problem, self.parameters), format_name(self.solver, self.options), *words])

    def _settings(self) -> dict[str, Any]:
        """Return all that shapes the motion except the code, as plain data."""
        return {
            "problem": self.problem,
            "parameters": dict(self.parameters),
            "solver": self.solver,
            "options": dict(self.options),
            "control": {k: getattr(self.control, k) for k in ("dt", "rtol", "max_step", "max_steps")},
        }


def make_spec(
    problem: Problem,
    solver: str,
    options: Mapping[str, Any] | None = None,
    control: Mapping[str, Any] | None = None,
    **limits: Any,
) -> RunSpec:
    """Return the specification of a run of ``problem``, made by the registry, with the solver of this name.

    ``options`` are those of the solver, ``control`` has step, tolerance and limit on steps by name, all as text or
    numbers; ``limits`` are other fields of ``RunSpec``. Raise ValueError in one line if any is invalid.
    """
    entry = registry.find_entry("solver", solver, registry.solvers())
    steps = make_step_control(solver, entry.control, problem, control or {})
    changed = entry.changed_options(entry.make_solver(options))
    return RunSpec(problem.name, solver, steps, dict(problem.parameters), changed, **limits)


def make_step_control(solver: str, kind: str, problem: Problem, given: Mapping[str, Any]) -> StepControl:
    """Return the ``StepControl`` of the values ``given`` by name, as text or numbers.

    ``kind`` is what controls the solver, ``dt`` or ``rtol``; by default the problem's dt, or ``DEFAULT_RTOL``. Raise
    ValueError if a value is invalid or does not go with ``kind``.
    """
    values = {k: _read_positive(k, v) for k, v in given.items()}
    if values.get("rtol", 0.0) >= 1.0:
        raise ValueError(f"rtol must be < 1: it is a share of the motion itself (got {given['rtol']!r})")
    if "dt" in values and "rtol" in values:
        raise ValueError("give exactly one of dt and rtol")
    other = {"dt": "rtol", "rtol": "dt"}[kind]
    if other in values:
        raise ValueError(f"solver {solver} is controlled by {kind}, not by {other}")
    if kind == "dt" and "max_step" in values:
        raise ValueError(f"solver {solver} takes a fixed dt: max_step goes with rtol")
    values.setdefault(kind, problem.dt if kind == "dt" else DEFAULT_RTOL)
    return StepControl(**values)


def check_step(dt: float | None, t_end: float) -> None:
    """Raise ValueError if a requested step is longer than the motion: another unit was meant."""
    if dt is not None and dt > t_end * (1.0 + 1e-9):
        raise ValueError(f"dt = {dt:g} s is longer than the motion, which ends at {t_end:g} s")


def _read_positive(name: str, given: Any) -> Any:
    """Return ``given``, the text or number of the value ``name``, as a float > 0, or as an int for ``max_steps``.

    Raise ValueError for anything else.
    """
    whole = name == "max_steps"
    wanted = "a whole number > 0 that fits 64 bits" if whole else "a finite number > 0"
    try:
        value = float(given)
        if isinstance(given, bool) or not 0.0 < value < (2**63 if whole else math.inf):
            raise ValueError
        if whole and not value.is_integer():
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be {wanted} (got {format_value(given)})") from None
    return int(value) if whole else value


def _digest(plain: Any) -> str:
    """Return the first 16 hexadecimal digits of the sha256 of JSON data."""
    text = json.dumps(plain, sort_keys=True, default=list)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
