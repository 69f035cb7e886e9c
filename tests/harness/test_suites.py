"""Suites expand into cells, and every wrong one is told in one line with its place."""

import pytest

from harness.suites import SuiteError, load_suite, parse_suite, suite_names

GROUP = '[[cells]]\nproblem = "free_fall"\nsolver = "exact"\n'


def cells(text: str):
    return parse_suite(text, "test", "test.toml").cells


def test_lists_are_products():
    """Two problems' parameters x two solvers x three steps."""
    made = cells(
        '[[cells]]\nproblem = "free_fall"\nparameters = {mass = [1, 2.0]}\n'
        'solver = ["exact", "raises"]\ndt = [0.1, 0.2, 1]'
    )
    assert len(made) == 12 and len({c.settings for c in made}) == len({c.case for c in made}) == 12


def test_defaults_are_the_same_cell():
    """Said or left out, text or number: what is run is the same, so its address is."""
    (plain,) = cells(GROUP)
    (said,) = cells(GROUP + 'parameters = {mass = "2"}\noptions = {lift = 0}\ndt = "5e-1"')
    assert plain.settings == said.settings and plain.address("code") == said.address("code")
    assert plain.address("code") != plain.address("other code")
    (limited,) = cells(GROUP + "wall_limit = 7")
    assert limited.settings == plain.settings and limited.address("code") != plain.address("code")


def test_a_tuple_parameter_takes_a_flat_list():
    """(1, 2, 3) is one value of omega; a list of such lists is a product."""
    text = '[[cells]]\nproblem = "torque_free_body"\nsolver = "exact"\nparameters = { omega = %s }'
    assert len(cells(text % "[1, 2, 4]")) == 1
    assert len(cells(text % "[[1, 2, 4], [0, 0, 1]]")) == 2


def test_cells_survive_their_trip_to_the_worker(tmp_path):
    """What the worker gets is what was checked: same address."""
    from harness.job import Job

    for cell in cells(
        '[[cells]]\nproblem = "torque_free_body"\nsolver = "exact"\nparameters = { omega = [1, 2, 4], yaw = 0.7 }'
    ):
        job = Job(cell, tmp_path, "s", "code", "commit", ("p",))
        assert Job.from_json(job.to_json()).id == job.id


BAD = {
    "": "at least one",
    "cells = 3": "at least one",
    "[[cells]]\n": "problem must be",
    "x = [": "test.toml",
    "sweets = 1\n" + GROUP: "unknown key 'sweets'",
    GROUP.replace("free_fall", "free_fal"): "did you mean 'free_fall'",
    GROUP.replace("exact", "exakt"): "did you mean 'exact'",
    GROUP + "problm = 1": "did you mean 'problem'",
    GROUP + "options = {lfit = 1}": "did you mean 'lift'",
    GROUP + "options = 3": "expected a table",
    GROUP + "parameters = {mass = -1}": "mass must be > 0",
    GROUP + "parameters = {mass = nan}": "mass",
    GROUP + "parameters = {mass = []}": "empty list",
    GROUP + "dt = 0": "dt must be",
    GROUP + "dt = -0.1": "dt must be",
    GROUP + 'dt = "quick"': "dt must be",
    GROUP + "dt = true": "dt must be",
    GROUP + "dt = []": "empty list",
    GROUP + "rtol = 1e-6": "controlled by dt",
    GROUP + "max_step = 0.1": "max_step",
    GROUP + "max_steps = 1.5": "max_steps",
    GROUP + "wall_limit = 0": "wall_limit",
    GROUP + "wall_limit = inf": "wall_limit",
    GROUP + "repeats = 1.5": "repeats",
    GROUP + "repeats = [1]": "repeats",
    GROUP + "label = 1": "label",
    GROUP + GROUP: "there twice",
    GROUP + "dt = [0.5, 0.5]": "there twice",
    'name = "../x"\n' + GROUP: "name must be",
    'plugins = ["nowhere.py"]\n' + GROUP: "nowhere.py",
    "plugins = [1]\n" + GROUP: "plugins",
    "[defaults]\nproblem = 1\n" + GROUP: "unknown key",
    "defaults = 1\n" + GROUP: "defaults",
}


@pytest.mark.parametrize("text", BAD, ids=range(len(BAD)))
def test_wrong_suites_are_told_in_a_line(text):
    """With the file, the group, and what was expected."""
    with pytest.raises(SuiteError) as error:
        cells(text)
    assert BAD[text] in str(error.value) and "\n" not in str(error.value) and "test.toml" in str(error.value)


@pytest.mark.parametrize("name", suite_names())
def test_our_suites_are_sound(name):
    """Every name, option and product in harness/suites/ exists."""
    suite = load_suite(name)
    assert suite.name == name and suite.description and len(suite.cells) > 0
