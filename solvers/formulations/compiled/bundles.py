"""Bundles whose arrays are declared by shape: ``"nb 6"`` has six numbers for each body, ``"nr"`` one for each row."""

from collections import namedtuple
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .kernel import Kernel


def make_bundle(
    name: str, arrays: Mapping[str, str], sizes: Mapping[str, int], entries: Sequence[str] = (), **given: Any
) -> Any:
    """Make a named tuple of the ``given`` values, zero arrays of the declared shapes, and ``entries`` still unset (0).

    ``arrays`` maps names to shapes such as "nb 6"; ``sizes`` has the number that each symbol in them stands for.
    """
    zeros = {n: np.zeros([sizes[d] if d in sizes else int(d) for d in shape.split()]) for n, shape in arrays.items()}
    kind = namedtuple(name, (*given, *zeros, *entries), defaults=(0,) * len(entries))  # type: ignore[misc]
    return kind(**given, **zeros)


def make_step(
    kernel: Kernel, control: np.ndarray, *, arrays: Mapping[str, str], entries: Sequence[str] = (), **given: Any
) -> Any:
    """Make the bundle of a method's step: control, kernel, ``given`` values, zero arrays, and entries still unset (0).

    The shapes of ``arrays`` are in numbers, of bodies ``nb`` and of constraint rows ``nr``.
    """
    sizes = {"nb": len(kernel.mass), "nr": len(kernel.lam)}
    return make_bundle("Step", arrays, sizes, entries, control=control, kernel=kernel, **given)


def make_record(**values: float) -> np.ndarray:
    """Make a NumPy record with a field for each of ``values``: int64 for integers, float64 for others."""
    return np.array(tuple(values.values()), [(n, "i8" if isinstance(x, int) else "f8") for n, x in values.items()])
