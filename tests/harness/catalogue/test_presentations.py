"""The one list of presentations, the parameters of every problem and what mechanics does to a system agree."""

import dataclasses

from mbsbench.harness.catalogue.registry import COMMON_PARAMETERS
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.mechanics.types.presentations import PRESENTATIONS


def test_every_parameter_but_those_of_the_motion_is_listed():
    others = {"t_end", "perturb", "seed"}  # the problem is another one
    assert sorted(p.name for p in PRESENTATIONS) == sorted(set(COMMON_PARAMETERS) - others)


def test_what_is_undone_is_what_mechanics_transforms_back():
    fields = {f.name for f in dataclasses.fields(Presentation)}
    assert {p.name for p in PRESENTATIONS if p.undone} == fields | {"retrace"}


def test_every_tried_value_changes_the_parameter():
    assert all(p.tried != COMMON_PARAMETERS[p.name][0] for p in PRESENTATIONS)
