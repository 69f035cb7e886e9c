"""Runs of a case changed by rounding alone: its start, its frame, its tolerance, and the kernels of its linear algebra.

Each moves what a run computes with by a few units in the last place, of whatever number, and nothing else: a start by
``SIZE`` of its poses and velocities; the frame by ``SIZE`` [rad] about an arbitrary axis, so that numbers that were
zero are not; a tolerance by ``OF_TOLERANCE`` of itself; a sum by its order, which BLAS chooses by the processor.

A frame turned by a finite angle is no rounding: errors of ODE-GC (by c_R), of charts and of tolerances that hold for
each component depend on the axes. It is a presentation, whose errors are compared elsewhere, and bounds none here.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count, islice

import numpy as np

from ..catalogue import registry
from ..machine import CORE, processor_flags
from ..suites.spec import RunSpec

SIZE = 1e-15  # relative, and rad: four or five units in the last place
OF_TOLERANCE = 1e-13  # hundreds of roundings: a step's size is a root of it; and far below what an error is known to
START, FRAME, TOLERANCE = "start", "frame", "tolerance"
CORES = {"Haswell": "avx2", "Zen": "avx2", "Sandybridge": "avx", "SkylakeX": "avx512vl"}  # and what a processor needs


@dataclass(frozen=True)
class Repeat:
    """The run ``spec`` of a ``case``, changed by one kind of rounding, with the BLAS kernels of ``core``."""

    case: str
    kind: str
    spec: RunSpec
    core: str = ""  # "": the harness's own

    @property
    def environ(self) -> dict[str, str]:
        """Variables of the processes that make it."""
        return {CORE: self.core, "OPENBLAS_CORETYPE": self.core} if self.core else {}  # pinned, and natively


def cores_here() -> tuple[str, ...]:
    """Core types of OpenBLAS whose kernels run on this processor."""
    return tuple(core for core, needed in CORES.items() if needed in processor_flags())


def repeat_run(spec: RunSpec, times: int, cores: Sequence[str]) -> list[Repeat]:
    """``times`` repeats, of each kind in turn; in each round after the first the kernels meet another start."""
    return list(islice(_rounds(spec, cores), times))


def _rounds(spec: RunSpec, cores: Sequence[str]) -> Iterator[Repeat]:
    """Repeats without end. A start that breaks the constraints on purpose is not moved, since it would be projected."""
    given = spec.parameters
    moves = not given.get("perturb") and not registry.make_problem(spec.problem, given).literal_start
    for seed in count(1):
        moved = {"perturb": SIZE, "seed": seed} if moves else {}
        turn = np.array(given.get("rotation", (0.0, 0.0, 0.0))) + SIZE * np.random.default_rng(seed).standard_normal(3)
        if moves:
            yield Repeat(spec.case, START, _with_parameters(spec, moved))
        yield Repeat(spec.case, FRAME, _with_parameters(spec, {"rotation": tuple(map(float, turn))}))
        if spec.control.rtol is not None:
            rtol = spec.control.rtol * (1.0 + (-1) ** seed * seed * OF_TOLERANCE)
            yield Repeat(spec.case, TOLERANCE, replace(spec, control=replace(spec.control, rtol=rtol)))
        for core in cores:
            yield Repeat(spec.case, f"BLAS {core}", _with_parameters(spec, moved if seed > 1 else {}), core)


def _with_parameters(spec: RunSpec, changes: Mapping[str, object]) -> RunSpec:
    return replace(spec, parameters={**spec.parameters, **changes})
