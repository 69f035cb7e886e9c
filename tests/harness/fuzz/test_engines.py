"""Engines answer alike for a mechanism as drawn, with a body split into two welded ones, and turned."""

import importlib.util

import pytest

from mbsbench.harness.fuzz.drawing import draw_mechanism
from mbsbench.harness.fuzz.oracle import Kind, Oracle
from mbsbench.harness.fuzz.presenting import Form

NUMBERS = (0, 1, 3, 4, 5)  # the second is the published finding exudyn-2
FORMS = {"split": Form(1), "turned": Form(0, "fixed", (0.3, -1.1, 0.7)), "both": Form(1, "fixed", (0.3, -1.1, 0.7))}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
@pytest.mark.parametrize("engine", ["exudyn", "mujoco", "pinocchio"])
def test_a_split_and_turned_mechanism_moves_as_it_was_drawn(engine, form):
    if importlib.util.find_spec(engine) is None:
        pytest.skip(f"{engine} is not installed: make engines")
    outcomes = [Oracle(draw_mechanism(1, number), form).examine(engine) for number in NUMBERS]
    assert {o.kind for o in outcomes} & {Kind.SOUND} and not [o for o in outcomes if o.kind is Kind.PRESENTATION]
    assert all(o.kind is not Kind.PARTLY_REFUSED for o in outcomes)
