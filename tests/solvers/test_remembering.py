"""The last result is kept for the very same objects, and for no others."""

from dataclasses import replace

import numpy as np

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.solvers.formulations.joint_coordinates.counting import build_tree
from mbsbench.solvers.formulations.joint_coordinates.remembering import remember_last


def test_a_result_is_given_again_for_the_same_objects_alone():
    calls = []
    last = remember_last(lambda *given: calls.append(given) or len(calls))
    a, equal_to_a, b = [1.0], [1.0], [2.0]
    assert [last(a, b), last(a, b), last(equal_to_a, b), last(a, b), last(a)] == [1, 1, 2, 3, 4]


def test_a_tree_is_built_anew_for_another_start():
    problem = make_problem("heavy_top")
    other = replace(problem.initial, Omega=2.0 * problem.initial.Omega)
    tree, again, faster = (build_tree(problem.system, s) for s in (problem.initial, problem.initial, other))
    assert tree is again
    assert not any(
        a.flags.writeable for a in (tree.base, tree.frames, tree.start, *tree.limbs[0]) if isinstance(a, np.ndarray)
    )
    rates = slice(tree.nq, None)
    np.testing.assert_allclose(faster.start[rates], 2.0 * tree.start[rates], rtol=1e-14)
