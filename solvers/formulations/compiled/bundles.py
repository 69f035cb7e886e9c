"""Bundles whose arrays are declared by shape: ``"nb 6"`` is room for six numbers a body, ``"nr"`` for one a row."""

from collections import namedtuple
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .kernel import Kernel


def make_bundle(
    name: str, arrays: Mapping[str, str], sizes: Mapping[str, int], entries: Sequence[str] = (), **given: Any
) -> Any:
    """A named tuple of what is given, of zeros in these shapes, and of entries that are still to be made."""
    zeros = {n: np.zeros([sizes[d] if d in sizes else int(d) for d in shape.split()]) for n, shape in arrays.items()}
    kind = namedtuple(name, (*given, *zeros, *entries), defaults=(0,) * len(entries))  # type: ignore[misc]
    return kind(**given, **zeros)


def make_step(
    kernel: Kernel, control: np.ndarray, *, arrays: Mapping[str, str], entries: Sequence[str] = (), **given: Any
) -> Any:
    """The bundle of a step: control, kernel, what is given, and arrays by numbers of bodies nb and of rows nr."""
    sizes = {"nb": len(kernel.mass), "nr": len(kernel.lam)}
    return make_bundle("Step", arrays, sizes, entries, control=control, kernel=kernel, **given)


def make_record(**values: float) -> np.ndarray:
    """A record of these numbers, whole ones as such."""
    return np.array(tuple(values.values()), [(n, "i8" if isinstance(x, int) else "f8") for n, x in values.items()])
