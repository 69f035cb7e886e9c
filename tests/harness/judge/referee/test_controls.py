"""A control beside each blame: the same asked of another solver in the same chart at the same tolerance."""

import math

from mbsbench.reports.model.claim_words import describe_control, format_by_solver
from mbsbench.tests.factories import make_record, parse_specs

from .claiming import RUNS, claim, options

MORE = parse_specs("""
[[runs]]
problem = "spherical_pendulum"
solver = "rk45_strong_form"
options = { coordinates = ["euler313", "quaternion"] }
rtol = [1e-3, 1e-4, 1e-6]
max_step = 0.01
""")
SPECS = (*RUNS, *MORE)
MAPS = """
[maps.rk]
over = [{ problem = "spherical_pendulum", solver = "rk45_strong_form", max_step = 0.01, "tolerance, chart" = "any" }]

"""
TEST = 'map = "m"\ncontrol = "rk"\ntests = [{ metric = "column", name = "phi_max", at_least = 1.0, unit = "m" }]\n'


def asked(size, text=TEST):
    """The claim with a control; ``size`` gives |phi| for solver, chart and tolerance."""
    found = [make_record(x, phi_max=size(x.solver, options(x)["chart"], x.control.rtol)) for x in SPECS]
    return claim(text + "\n" + MAPS, found, specs=SPECS)


def test_a_control_that_does_the_same_is_said():
    """Both err in Euler angles: the claim holds there, and tells nothing of its solver."""
    c = asked(lambda solver, chart, tolerance: 2.0 if chart == "euler313" else 0.1)
    assert (c.control.finding.holds, c.control.finding.settings, c.control.both) == (3, 6, 6)
    assert c.control.solvers == ("rk45_strong_form",) and "does so too (3 of 6 tried)" in describe_control(c)
    beside = {(m.at["chart"], m.control, m.control_holds) for m in c.map}
    assert beside == {("euler313", 2.0, True), ("quaternion", 0.1, False)}


def test_a_control_that_does_otherwise_is_said():
    c = asked(lambda solver, chart, tolerance: 0.1 if solver == "rk45_strong_form" else 2.0)
    assert c.verdict == "reproduced" and c.control.both == 0 and "does not (none of 6 tried)" in describe_control(c)


def test_a_control_stands_beside_equal_chart_and_tolerance():
    """The number in a row is that of the control run with its chart and tolerance."""
    c = asked(lambda solver, chart, tolerance: (tolerance or 1.0) * (1.0 if chart == "euler313" else 2.0))
    for m in c.map:
        factor = 1.0 if m.at["chart"] == "euler313" else 2.0
        assert math.isclose(m.control, m.at["tolerance"] * factor, rel_tol=1e-3)


def test_without_a_control_there_is_none():
    assert claim().control is None and describe_control(claim()) == ""


def test_codes_are_columns():
    """Of two solvers in one map each has its finding; of one there is none."""
    both = TEST.replace('map = "m"\ncontrol = "rk"', 'map = "both"')
    maps = MAPS + '[maps.both]\nover = [{ map = "m" }, { map = "rk" }]\n'
    found = [make_record(x, phi_max=0.1 if x.solver == "rk45_strong_form" else 2.0) for x in SPECS]
    c = claim(both + "\n" + maps, found, specs=SPECS)
    assert {k: (f.verdict, f.settings) for k, f in c.by_solver.items()} == {
        "ida_index1": ("reproduced", 12),
        "rk45_strong_form": ("not reproduced", 6),
    }
    assert "by ida_index1 reproduced, for all 12 tried" in format_by_solver(c) and claim().by_solver == {}


def test_ranges_of_a_dimension_are_readings_of_one_claim():
    """From 1e-3 to 1e-4 the error stays, from 1e-4 to 1e-6 it falls: reproduced if the first range is meant."""
    text = TEST.replace('control = "rk"', 'across = "tolerance"\nranges = [[1e-3, 1e-4], [1e-4, 1e-6]]')
    text = text.replace("at_least = 1.0", 'combine = "smallest", at_least = 0.5')
    c = claim(text, [make_record(x, phi_max=1e-6 if x.control.rtol == 1e-6 else 1.0) for x in RUNS])
    assert c.verdict == "reproduced if" and c.beyond.decision.by == {"tolerance range": ("0.001 to 0.0001",)}


def test_a_control_that_the_dimension_does_not_act_on_tells_nothing_of_a_spread():
    """Its runs are equal at every tolerance, since the largest step binds: no spread, and no answer."""
    text = TEST.replace("tests", 'across = "tolerance"\ntests').replace("at_least", 'combine = "spread", at_least')

    def words(*equal):
        found = [
            make_record(
                x,
                phi_max=0.1 if x.solver in equal else 1e3 * x.control.rtol if x.control.rtol else 0.5,
                series_sha256=x.solver if x.solver in equal else x.case,
            )
            for x in SPECS
        ]
        return describe_control(
            claim(text.replace("at_least = 1.0", "at_least = 0.5") + "\n" + MAPS, found, specs=SPECS)
        )

    assert "settles nothing" in words("rk45_strong_form") and "does so too" in words()
