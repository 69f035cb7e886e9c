"""What compiled steps call meets its laws as machine code: the kernel's entries, free bodies, the block LU."""

import pytest

from .laws import make_laws
from .newton_laws import make_newton_laws

ROOMS = ("kernel", "rotations", "rattle", "lie_variational", "radau_ggl", "saddle")
LAWS = [*make_laws(ROOMS), *make_newton_laws(("gc_weak_form", "gc_augmented_lagrangian"))]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_law(law):
    """Each quantity is that of plain NumPy."""
    law.compare(law.solve())


def test_a_quantity_that_differs_is_named():
    """With its place and both numbers; one that is not a number, too."""
    law = make_laws(("radau_ggl",))[0]
    for wrong in (0.25, float("nan")):
        found = {name: x.copy() for name, x in law.plain.items()}
        found["a"][1, 2] = wrong
        with pytest.raises(AssertionError, match=rf"coefficients: a\[1, 2\] is {wrong}, by the plain method -0\."):
            law.compare(found)
