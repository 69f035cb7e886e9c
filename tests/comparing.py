"""Assertions about arrays that print both numbers where they fail."""

import operator

import numpy as np

RELATIONS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq}


def assert_each(found, relation, limit, what=""):
    """Assert the relation for each element; name the place where it fails by most, and both numbers there."""
    __tracebackhide__ = True
    one, two = np.broadcast_arrays(found, limit)
    fails = ~RELATIONS[relation](one, two)  # NaN fails
    if not np.any(fails):
        return
    places = np.argwhere(fails)
    gaps = np.abs(np.subtract(one[fails], two[fails], dtype=float))
    worst = tuple(int(k) for k in places[np.argmax(np.where(np.isnan(gaps), np.inf, gaps))])
    raise AssertionError(
        f"{what or 'values'}: {one[worst]!r} at {worst} is not {relation} {two[worst]!r}; "
        f"so fail {len(places)} of {one.size}"
    )


def assert_close(found, wanted, rtol=1e-5, atol=1e-8, equal_nan=False, what=""):
    """Assert |found - wanted| <= atol + rtol |wanted| for each element; print the largest gaps and both arrays."""
    __tracebackhide__ = True
    one, two = np.broadcast_arrays(found, wanted)
    np.testing.assert_allclose(one, two, rtol=rtol, atol=atol, equal_nan=equal_nan, err_msg=str(what))


def assert_same(found, wanted, equal_nan=False, what=""):
    """Assert one shape, and equal elements; NaN is equal to NaN only if ``equal_nan``. Name the worst place."""
    __tracebackhide__ = True
    one, two = np.asarray(found), np.asarray(wanted)
    assert one.shape == two.shape, f"{what or 'values'}: shape {one.shape} is not {two.shape}"
    if equal_nan:
        np.testing.assert_array_equal(one, two, err_msg=str(what))
    else:
        assert_each(one, "==", two, what)
