"""Parameters of tests, of which some are enough for ``make test``: the others are slow, so that all are still run."""

from collections.abc import Callable, Iterable, Sequence
from itertools import product
from typing import Any

import pytest


def few(cases: Iterable[Any], keep: Callable[[Any], bool]) -> list[Any]:
    """All cases as parameters; those that ``keep`` does not hold for are slow. A case of several values is a tuple."""
    return [_param(case, keep(case)) for case in cases]


def every(cases: Iterable[Any], n: int) -> list[Any]:
    """All cases as parameters; all but the first of each n are slow."""
    return [_param(case, k % n == 0) for k, case in enumerate(cases)]


def diagonal(*axes: Sequence[Any]) -> list[Any]:
    """The whole product as parameters; slow are all but as many as the longest axis has, in which each value occurs."""
    most = max(map(len, axes))
    kept = {tuple(k % len(axis) for axis in axes) for k in range(most)}
    places = product(*(range(len(axis)) for axis in axes))
    return [_param(tuple(a[k] for a, k in zip(axes, at, strict=True)), at in kept) for at in places]


def one(value: Any, *places: int) -> Any:
    """One value made at these places of axes, a tuple too; slow is every other one of the product.

    Of three axes or more those that are left have every pair of values.
    """
    return _param((value,), sum(places) % 2 == 0)


def _param(case: Any, kept: bool) -> Any:
    """One or several values, with the marker of slow tests or without."""
    values = case if isinstance(case, tuple) else (case,)
    return pytest.param(*values, marks=() if kept else pytest.mark.slow)
