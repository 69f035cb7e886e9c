"""Products in a fixed order are those of NumPy but for rounding, and their rounding is that of the order."""

import numpy as np

from mbsbench.harness.mechanics.fixed_order import apply, dot, inverse, product
from mbsbench.harness.mechanics.joint_tree import _find_rates_about
from mbsbench.tests.comparing import assert_same


def test_products_are_numpys():
    """Of matrices, vectors and stacks of them; without rows as well."""
    random = np.random.default_rng(4)
    A, B, x = random.standard_normal((5, 3, 3)), random.standard_normal((5, 3, 2)), random.standard_normal((5, 3))
    np.testing.assert_allclose(product(A, B), A @ B, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(apply(A, x), np.einsum("bij,bj->bi", A, x), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(dot(x[0], x[1]), x[0] @ x[1], rtol=0.0, atol=1e-14)
    assert apply(np.zeros((0, 3)), x[0]).shape == (0,)


def test_terms_are_added_one_after_another():
    """(1e16 + 1) - 1e16 is 0 and 1e16 - 1e16 + 1 is 1: any other order, or a fused product, shows."""
    a, ones = np.array([1e16, 1.0, -1e16]), np.ones(3)
    assert dot(a, ones) == product(a[None], ones[:, None])[0, 0] == apply(a[None], ones)[0] == 0.0
    assert dot(a[[0, 2, 1]], ones) == product(a[None, [0, 2, 1]], ones[:, None])[0, 0] == 1.0
    u = 1.0 + 2.0**-30
    assert dot(np.array([-u * u, u]), np.array([1.0, u])) == 0.0  # fused, it would be the rounding of u u


def test_rates_about_hinges_are_those_of_least_squares():
    """One axis, or two that are neither parallel nor normal to each other; what is across them is left out."""
    random = np.random.default_rng(5)
    for n in (1, 2):
        turns, omega = random.standard_normal((n, 3)), random.standard_normal(3)
        expected = np.linalg.lstsq(turns.T, omega, rcond=None)[0]
        np.testing.assert_allclose(_find_rates_about(turns, omega), expected, rtol=1e-12)


def test_inverses_are_numpys_and_exact_where_they_can_be():
    """Of inertias about any axes, of a tableau; of a diagonal each reciprocal, rounded once."""
    random = np.random.default_rng(6)
    A = random.standard_normal((4, 3, 3))
    J = A @ np.swapaxes(A, 1, 2) + 0.1 * np.eye(3)
    np.testing.assert_allclose(inverse(J) @ J, np.broadcast_to(np.eye(3), J.shape), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(inverse(J), np.linalg.inv(J), rtol=1e-10)
    d = random.uniform(0.1, 3.0, 3)
    assert_same(inverse(np.diag(d)), np.diag(1.0 / d))
