"""Runs stand where their settings put them, and no claim gathers runs it was not written for."""

from mbsbench.harness.judge.referee.claims.frame import (
    find_varied,
    is_printed,
    list_values,
    read_dimensions,
    select_runs,
)
from mbsbench.tests.factories import parse_specs

PENDULUM = """
[[runs]]
problem = "spherical_pendulum"
solver = "ida_index1"
options = { form = ["fi", "se"], coordinates = ["euler313", "quaternion"] }
rtol = [1e-3, 1e-6]
max_step = 0.01

[[runs]]
problem = "spherical_pendulum"
solver = "ida_index1"
options = { alpha = 20.0, beta = 20.0, form = "fi" }
rtol = 1e-3
max_step = 0.01

[[runs]]
problem = "spherical_pendulum"
parameters = { yaw = 0.7 }
solver = "ida_index1"
rtol = 1e-3
max_step = 0.01

[[runs]]
problem = "spherical_pendulum"
solver = "gc_weak_form"
options = { gauge = ["symmetric", "zero"] }
dt = [0.01, 0.02]

[[runs]]
problem = "torque_free_body"
parameters = { t_end = 300.0 }
solver = "gc_weak_form"
dt = 300.0
"""
PLACES = tuple(read_dimensions(c) for c in parse_specs(PENDULUM))
BASE = {"problem": "spherical_pendulum", "solver": "ida_index1", "max_step": 0.01, "tolerance": "any"}


def test_dimensions_have_the_names_of_claims():
    """Charts, gains, frames and steps are called the same for every solver."""
    first = PLACES[0].dimensions
    assert (first["form"], first["chart"], first["gain"], first["tolerance"], first["frame"]) == (
        "fi",
        "euler313",
        5.0,
        1e-3,
        "aligned",
    )
    assert PLACES[8].dimensions["gain"] == 20.0
    assert PLACES[9].dimensions["frame"] == "yawed by 0.7 rad"
    assert PLACES[10].dimensions["step"] == 0.01 and PLACES[10].dimensions["tolerance"] == 1e-8
    assert PLACES[14].dimensions["step"] == "the whole run" and PLACES[14].dimensions["duration"] == 300.0
    assert PLACES[0].dimensions["duration"] == 40.0


def test_the_form_of_the_ndf_is_that_of_its_accelerations():
    """With unknown accelerations the equations are those of form fi: one name for what IDA and the NDF both have."""
    text = """
[[runs]]
problem = "heavy_top"
solver = "ndf_index1"
options = { accelerations = ["unknown", "eliminated"] }
rtol = 1e-4
"""
    fi, se = (read_dimensions(c) for c in parse_specs(text))
    assert (fi.dimensions["form"], se.dimensions["form"]) == ("fi", "se") and "accelerations" not in fi.dimensions
    asked = {"problem": "heavy_top", "solver": "ndf_index1", "tolerance": 1e-4}
    assert select_runs((fi, se), [asked]) == (fi,) and select_runs((fi, se), [asked | {"form": "se"}]) == (se,)


def test_what_is_not_named_must_be_usual():
    """Only the usual gain, chart, form and frame; then one more at a time."""
    assert len(select_runs(PLACES, [BASE])) == 2
    assert len(select_runs(PLACES, [{**BASE, "chart": "any"}])) == 4
    assert len(select_runs(PLACES, [{**BASE, "chart": "any", "form": "any"}])) == 8
    assert len(select_runs(PLACES, [{**BASE, "gain": "any"}])) == 3
    assert len(select_runs(PLACES, [{**BASE, "frame": "any", "tolerance": [1e-3]}])) == 2
    assert len(select_runs(PLACES, [{**BASE, "tolerance": {"from": 0.1, "to": 1e-3}}])) == 1
    assert select_runs(PLACES, [{**BASE, "max_step": 0.1}]) == ()
    assert select_runs(PLACES, [{k: v for k, v in BASE.items() if k != "max_step"}]) == ()


def test_a_union_holds_each_place_once():
    both = select_runs(PLACES, [BASE, {**BASE, "chart": "any"}])
    assert len(both) == 4
    assert find_varied([p.dimensions for p in both]) == {"tolerance": [1e-6, 1e-3], "chart": ["euler313", "quaternion"]}


def test_of_runs_that_differ_in_limits_alone_the_one_with_a_budget_counts():
    """A stuck run without a limit on its steps is ended by a clock; whichever comes first."""
    text = '[[runs]]\nproblem = "heavy_top"\nsolver = "gc_weak_form"\ndt = 0.001\n'
    for suite in (text + text + "max_steps = 20000\n", text + "max_steps = 20000\n" + text):
        places = [read_dimensions(c) for c in parse_specs(suite)]
        found = select_runs(
            places, [{"problem": "heavy_top", "solver": "gc_weak_form", "step": 0.001, "tolerance": "any"}]
        )
        assert [p.spec.control.max_steps for p in found] == [20_000]


def test_printed_settings_are_recognised():
    printed = [{"chart": "euler313", "tolerance": [1e-3, 1e-4]}]
    assert is_printed(PLACES[0], printed) and not is_printed(PLACES[1], printed)
    assert not is_printed(PLACES[0], [])


def test_printed_values_are_those_of_the_suite():
    """Fig. 5: the tolerance 1e-3 in Euler angles, as the suite ``paper`` has it under that label."""
    printed = [{"chart": "as printed", "tolerance": "as printed"}]
    found = {(p.dimensions["chart"], p.dimensions["tolerance"]) for p in PLACES if is_printed(p, printed)}
    assert found == {("euler313", 1e-3)}
    assert not any(is_printed(p, [{**printed[0], "solver": "ndf_index1"}]) for p in PLACES)


def test_values_come_in_order():
    """Numbers by size, truth before its contrary, texts, and last what does not exist."""
    assert list_values([None, "b", 2.0, 1.0, "a"]) == [1.0, 2.0, "a", "b", None]
    assert list_values([False, True]) == [True, False]
