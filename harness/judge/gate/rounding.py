"""Repeat runs changed by rounding only: of the start, the frame, the tolerance, and the linear algebra kernels.

Each change moves the numbers of a run by a few units in the last place: the start by ``SIZE`` of its poses and
velocities; the frame by ``SIZE`` [rad] about a random axis, so that zeros become small numbers; the tolerance by
``OF_TOLERANCE`` of itself; the order of sums by other BLAS kernels.

A frame turned by a finite angle is no rounding: errors of ODE-GC (by c_R), of charts and of tolerances per component
depend on the axes. It is a presentation, whose errors are compared elsewhere, and sets no bounds here.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count, islice

import numpy as np

from ...base.machine import CORE, read_processor_flags
from ...catalogue import registry
from ...catalogue.suites.spec import RunSpec

SIZE = 1e-15  # relative, and rad: four or five units in the last place
OF_TOLERANCE = 1e-13  # hundreds of roundings, since a step's size is a root of it; far below the accuracy of an error
START, FRAME, TOLERANCE = "start", "frame", "tolerance"
# core types, and the flags that they need
CORES = {"Haswell": "avx2", "Zen": "avx2", "Sandybridge": "avx", "SkylakeX": "avx512vl"}


def choose_kernels(core: str) -> dict[str, str]:
    """Return environment variables that select the BLAS kernels of the core type ``core``; none if it is empty."""
    # the first is read by processes of the harness, the second by those without pinned kernels
    return {CORE: core, "OPENBLAS_CORETYPE": core} if core else {}


def list_core_types() -> tuple[str, ...]:
    """Return the core types of OpenBLAS whose kernels run on this processor."""
    return tuple(core for core, needed in CORES.items() if needed in read_processor_flags())


def repeat_run(spec: RunSpec, times: int, cores: Sequence[str]) -> list[tuple[str, RunSpec, str]]:
    """Return ``times`` repeats of a run, changed by each kind of rounding in turn: kind, settings and core type.

    The core type of OpenBLAS is empty for the kernels that the harness pins; ``cores`` are the others that are tried.
    Repeats with these have a perturbed start from the second round on, as they would equal those of the first.
    """
    return list(islice(_list_repeats(spec, cores), times))


def _list_repeats(spec: RunSpec, cores: Sequence[str]) -> Iterator[tuple[str, RunSpec, str]]:
    """Yield repeats of a run without end: kind of rounding, settings and core type of each.

    A start that is perturbed already, or opens its joints on purpose, is not perturbed: that would project it onto
    the joints. Only runs under error control have repeats with another tolerance.
    """
    given = spec.parameters
    moves = not given.get("perturb") and not registry.make_problem(spec.problem, given).literal_start
    for seed in count(1):
        moved = {"perturb": SIZE, "seed": seed} if moves else {}
        turn = np.array(given.get("rotation", (0.0, 0.0, 0.0))) + SIZE * np.random.default_rng(seed).standard_normal(3)
        if moves:
            yield START, _replace_parameters(spec, moved), ""
        yield FRAME, _replace_parameters(spec, {"rotation": tuple(map(float, turn))}), ""
        if spec.control.rtol is not None:
            rtol = spec.control.rtol * (1.0 + (-1) ** seed * seed * OF_TOLERANCE)
            yield TOLERANCE, replace(spec, control=replace(spec.control, rtol=rtol)), ""
        for core in cores:
            yield f"BLAS {core}", _replace_parameters(spec, moved if seed > 1 else {}), core


def _replace_parameters(spec: RunSpec, changes: Mapping[str, object]) -> RunSpec:
    """Return the run with these parameters of its problem replaced."""
    return replace(spec, parameters={**spec.parameters, **changes})
