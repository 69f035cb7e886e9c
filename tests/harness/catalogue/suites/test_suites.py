"""Suites expand into runs, and every wrong one is told in one line with its place."""

import itertools
import os
from collections import Counter

import pytest

from mbsbench.harness.base.files import FileError
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.catalogue.suites.includes import find_suite_file, list_suites, read_source
from mbsbench.harness.catalogue.suites.suite import _add_defaults, _expand_group, count_runs, load_suite, parse_suite
from mbsbench.harness.run.job import Job
from mbsbench.harness.run.runner import Request, run_suite
from mbsbench.tests.factories import PLUGIN, Silent, parse_specs

GROUP = '[[runs]]\nproblem = "free_fall"\nsolver = "exact"\n'


def test_a_sweep_is_even_in_the_logarithm_and_has_both_ends():
    """To three digits, so that the values can be named."""
    swept = GROUP + "dt = { from = 0.1, to = 1e-3, per_decade = 2 }"
    assert [s.control.dt for s in parse_specs(swept)] == [0.1, 0.0316, 0.01, 0.00316, 0.001]


def test_lists_are_products():
    made = parse_specs(
        '[[runs]]\nproblem = "free_fall"\nparameters = {mass = [1, 2.0]}\n'
        'solver = ["exact", "raises"]\ndt = [0.1, 0.2, 1]'
    )
    assert len(made) == 12 and len({c.settings_id for c in made}) == len({c.case for c in made}) == 12


def test_keys_that_a_solver_does_not_take_are_named():
    """Where both kinds of control are given each solver takes its own; that, and no more, is said, once."""
    text = '[[runs]]\nproblem = "heavy_top"\nsolver = ["rattle", "rkmk_dopri5"]\ndt = [0.01, 0.005]\nrtol = 1e-6\n'
    made = parse_suite(
        text + "max_step = 0.1\n" + text.replace("1e-6", "1e-5").replace("0.005", "0.002").replace("0.01", "0.004"),
        "test",
        "test.toml",
    )
    assert made.not_combined == ("rattle with rtol", "rattle with max_step", "rkmk_dopri5 with dt")
    assert len(made.specs) == 6
    assert parse_suite(GROUP + "dt = [0.5, 0.25]", "test", "test.toml").not_combined == ()


def test_tables_follow_one_another_and_defaults_name_problem_and_solver():
    """A list of tables is a sum, not a product; what a group leaves out is the default."""
    text = '[defaults]\nproblem = "free_fall"\nsolver = "exact"\n[[runs]]\nparameters = [{mass = [1, 2]}, {mass = 3}]\n'
    assert [s.parameters.get("mass", 2.0) for s in parse_specs(text)] == [1.0, 2.0, 3.0]
    assert {s.solver for s in parse_specs(text + 'solver = "raises"')} == {"raises"}


def test_keys_that_share_a_value_vary_together():
    """Three gains alpha = beta, not nine pairs."""
    text = '[[runs]]\nproblem = "heavy_top"\nsolver = "ida_index1"\noptions = { "alpha, beta" = [0.0, 1.0, 2.0] }'
    assert [dict(s.options) for s in parse_specs(text)] == [{"alpha": a, "beta": a} for a in (0.0, 1.0, 2.0)]
    with pytest.raises(FileError, match="did you mean 'alpha'"):
        parse_specs(text.replace("alpha", "alhpa"))


def test_defaults_are_the_same_run():
    """Said or left out, text or number: what is run is the same, so its address is."""
    (plain,) = parse_specs(GROUP)
    (said,) = parse_specs(GROUP + 'parameters = {mass = "2"}\noptions = {lift = 0}\ndt = "5e-1"')
    assert plain.settings_id == said.settings_id and plain.address("code") == said.address("code")
    assert plain.address("code") != plain.address("other code")
    (limited,) = parse_specs(GROUP + "cpu_limit = 7")
    assert limited.settings_id == plain.settings_id and limited.address("code") != plain.address("code")


def test_a_tuple_parameter_takes_a_flat_list():
    """(1, 2, 3) is one value of omega; a list of such lists is a product."""
    text = '[[runs]]\nproblem = "torque_free_body"\nsolver = "exact"\nparameters = { omega = %s }'
    assert len(parse_specs(text % "[1, 2, 4]")) == 1
    assert len(parse_specs(text % "[[1, 2, 4], [0, 0, 1]]")) == 2


def test_runs_survive_their_trip_to_the_worker(tmp_path):
    for spec in parse_specs(
        '[[runs]]\nproblem = "torque_free_body"\nsolver = "exact"\nparameters = { omega = [1, 2, 4], yaw = 0.7 }'
    ):
        job = Job(spec, tmp_path, "s", "code", "commit", ("p",), lossless=True)
        again = Job.from_json(job.to_json())
        assert again.id == job.id and again.lossless


def written(folder, **files: str):
    """Suite files in a folder; the last one is loaded."""
    for name, text in files.items():
        (folder / f"{name}.toml").write_text(text)
    return lambda: load_suite(str(folder / f"{list(files)[-1]}.toml"))


def test_a_mark_of_the_order_of_bytes_is_no_part_of_a_suite(tmp_path):
    """Editors on Windows write one before UTF-8."""
    path = tmp_path / "marked.toml"
    path.write_bytes(b'\xef\xbb\xbf[[runs]]\nproblem = "simple_pendulum"\nsolver = "rkmk_dop853"\nrtol = 1e-6\n')
    assert len(load_suite(str(path)).specs) == 1


def test_included_runs_come_first_and_once(tmp_path):
    """Through two ways to one run, its first label and limits are kept; defaults stay in their own file."""
    base = 'label = "base"\ncpu_limit = 7'
    load = written(
        tmp_path,
        base=f'plugins = ["{PLUGIN}"]\ntotal_limit = 9\n{GROUP}dt = [0.5, 0.25]\n{base}',
        left=f'include = ["base"]\n[defaults]\nlabel = "left"\n{GROUP}dt = [0.5, 0.1]',
        right='include = ["base"]',
        top=f'include = ["left", "right", "./base.toml"]\n{GROUP}dt = [0.1, 0.05, 0.25]',
    )
    suite = load()
    assert [(c.control.dt, c.label, c.cpu_limit) for c in suite.specs] == [
        (0.5, "base", 7),
        (0.25, "base", 7),
        (0.1, "left", 60.0),
        (0.05, "", 60.0),
    ]
    assert suite.plugins == (str(PLUGIN),) and [n for n, _ in suite.included] == ["base", "left", "right"]
    assert suite.total_limit is None  # a limit is on the run that was asked for


def test_parts_of_a_suite_are_what_it_includes_and_what_that_includes(tmp_path):
    """By name, whatever was met first elsewhere; its own runs are no part."""
    load = written(
        tmp_path,
        base=f'plugins = ["{PLUGIN}"]\n{GROUP}dt = [0.5, 0.25]',
        left=f'include = ["base"]\n{GROUP}dt = [0.5, 0.1]',
        top=f'include = ["left"]\n{GROUP}dt = 0.05',
    )
    suite = load()
    steps = {s.settings_id: s.control.dt for s in suite.specs}
    parts = {name: {steps[i] for i in part} for name, part in suite.parts.items()}
    assert parts == {"base": {0.5, 0.25}, "left": {0.5, 0.25, 0.1}}


def test_shipped_suites_can_be_included(tmp_path):
    """A name that is not beside the file is one of ours; the file beside it goes first."""
    ci = load_suite("ci")
    suite = written(tmp_path, mine='include = ["ci"]\ntotal_limit = 60')()
    assert suite.specs == ci.specs and suite.total_limit == 60
    assert len(written(tmp_path, ci=GROUP, mine='include = ["ci"]')().specs) == 1


def test_a_run_folder_holds_a_suite_that_includes(tmp_path):
    suite = written(tmp_path, base=GROUP, top=f'include = ["base"]\nplugins = ["{PLUGIN}"]')()
    run_suite(Request(suite, tmp_path / "run", 1), Silent())
    assert load_suite(str(tmp_path / "run" / "suite.toml")).specs == suite.specs


INCLUDES = {
    'include = "base"': "must be a list",
    "include = [1]": "include 1 must be text",
    'include = [""]': "include 1 must be text of length",
    'include = ["bse"]': "did you mean 'base'",
    'include = ["top"]': "top includes top",
    'include = ["round"]': "top includes round includes top",
    'include = ["broken"]': "broken.toml: runs 1: unknown problem",
    'include = ["nowhere.toml"]': "cannot read suite",
    'include = ["other/base.toml", "base"]': "the same name",
    'include = ["suite"]': "the same name",
    "include = []": "at least one",
    'include = ["base"]\nruns = 3': "runs must be a list",
    "total_limit = 0\n" + GROUP: "total_limit",
    "total_limit = true\n" + GROUP: "total_limit",
    'total_limit = "1 h"\n' + GROUP: "total_limit",
}


@pytest.mark.parametrize("text", INCLUDES, ids=range(len(INCLUDES)))
def test_wrong_includes_are_reported_in_one_line(text, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "base.toml").write_text(GROUP)
    load = written(
        tmp_path, base=GROUP, round='include = ["top"]', broken=GROUP.replace("free", "fre"), suite=GROUP, top=text
    )
    with pytest.raises(FileError) as error:
        load()
    assert INCLUDES[text] in str(error.value) and "\n" not in str(error.value)


BAD = {
    "": "at least one",
    "runs = 3": "runs must be a list",
    "[[runs]]\n": "problem is missing",
    "x = [": "test.toml",
    "sweets = 1\n" + GROUP: "unknown key 'sweets'",
    GROUP.replace("free_fall", "free_fal"): "did you mean 'free_fall'",
    GROUP.replace("exact", "exakt"): "did you mean 'exact'",
    GROUP + "problm = 1": "did you mean 'problem'",
    GROUP + "options = {lfit = 1}": "did you mean 'lift'",
    GROUP + "options = 3": "options must be a table",
    GROUP + "parameters = {mass = -1}": "mass must be > 0",
    GROUP + "parameters = {mass = nan}": "mass",
    GROUP + "parameters = {mass = []}": "empty list",
    GROUP + "dt = 0": "dt must be",
    GROUP + "dt = -0.1": "dt must be",
    GROUP + 'dt = "quick"': "dt must be",
    GROUP + "dt = true": "dt must be",
    GROUP + "dt = []": "empty list",
    GROUP + "dt = { from = 0.1, to = 0.01 }": "dt must be a value, a list, or { from, to, per_decade }",
    GROUP + "dt = { from = 0.1, to = 0, per_decade = 2 }": "dt: a sweep goes from one number > 0 to another",
    GROUP + "dt = { from = 0.1, to = 0.1, per_decade = 2 }": "dt: a sweep goes from one number > 0 to another",
    GROUP + "rtol = 1e-6": "controlled by dt",
    GROUP + "max_step = 0.1": "max_step",
    GROUP + "max_steps = 1.5": "max_steps",
    GROUP + "cpu_limit = 0": "cpu_limit",
    GROUP + "cpu_limit = inf": "cpu_limit",
    GROUP + "cpu_limit = 1e300": "cpu_limit must be a finite number > 0, at most 1e+07",
    GROUP + "cpu_limit = 1" + "0" * 400: "cpu_limit",
    GROUP + "cpu_limit = 1" + "0" * 5000: "digits",
    GROUP + "memory = 1e300": "memory",
    GROUP + "max_steps = 1" + "0" * 30: "max_steps",
    GROUP + "max_steps = [1, 1e19]": "max_steps",
    GROUP + "dt = 1" + "0" * 400: "dt must be a finite number",
    GROUP + "options = {lift = 1" + "0" * 400 + "}": "lift must be",
    "total_limit = 1" + "0" * 400 + "\n" + GROUP: "total_limit",
    GROUP + "repeats = 1000000000000": "repeats",
    GROUP + "repeats = 1.5": "repeats",
    GROUP + "repeats = [1]": "repeats",
    GROUP + "label = 1": "label",
    GROUP + GROUP: "declared twice",
    GROUP + "dt = [0.5, 0.5]": "declared twice",
    'name = "../x"\n' + GROUP: "name must be",
    'plugins = ["nowhere.py"]\n' + GROUP: "nowhere.py",
    "plugins = [1]\n" + GROUP: "plugins",
    "[defaults]\nproblem = 1\n" + GROUP: "problem must be text or a list",
    "[defaults]\nproblme = 'x'\n" + GROUP: "did you mean 'problem'",
    '[[runs]]\nsolver = "exact"\n': "problem is missing",
    GROUP + "parameters = []": "parameters",
    "defaults = 1\n" + GROUP: "defaults",
}


@pytest.mark.parametrize("text", BAD, ids=range(len(BAD)))
def test_wrong_suites_are_reported_in_one_line(text):
    with pytest.raises(FileError) as error:
        parse_specs(text)
    assert BAD[text] in str(error.value) and "\n" not in str(error.value) and "test.toml" in str(error.value)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", list_suites())
def test_our_suites_are_sound(name):
    """Every name, option and product in harness/catalogue/suites/ exists."""
    suite = load_suite(name)
    assert suite.name == name and suite.description and len(suite.specs) > 0


ENGINES = ("mujoco", "exudyn", "pinocchio")


@pytest.mark.beyond_core
def test_bench_has_a_ladder_of_every_solver_on_every_problem_of_the_paper():
    """Five steps or tolerances at least, options left alone; the weak form alone refuses the redundant grid."""
    settings: dict[tuple[str, str], dict[str, set[float]]] = {}
    for s in load_suite("bench_engines").specs:
        if not s.options and s.label in ("recommended", "work"):
            steps = settings.setdefault((s.problem, s.solver), {}).setdefault(repr(s.parameters), set())
            steps.add(s.control.dt or s.control.rtol or 0.0)
    compared = {(s.problem, s.solver) for s in load_suite("paper").specs if s.label == "recommended"}
    assert len(compared) == 5 * 19
    assert not {s.solver for s in load_suite("bench").specs} & set(ENGINES)
    compared |= {(problem, s) for problem, _ in compared for s in ("dop853_joint", *ENGINES)}
    few = {pair for pair in compared if max(map(len, settings[pair].values())) < 5}
    assert few == {("four_bar_grid", "gc_weak_form")}


@pytest.mark.beyond_core
def test_the_first_pass_has_every_solver_once_on_each_problem_of_the_paper():
    """The problem's own step or one tolerance, and the very runs of the suite `paper` where that has them."""
    first, bench = load_suite("first").specs, load_suite("bench").specs
    solvers, problems = {s.solver for s in bench}, {s.problem for s in load_suite("paper").specs}
    assert Counter((s.problem, s.solver) for s in first) == dict.fromkeys(itertools.product(problems, solvers), 1)
    assert {s.label for s in first} == {"recommended"} and not any(s.options for s in first)
    for s in first:
        assert s.control.rtol in (None, 1e-6)
        assert s.control.dt in (None, registry.make_problem(s.problem, s.parameters).dt)
    addresses = {s.settings_id: s.address("code") for s in (*bench, *load_suite("paper").specs)}
    assert all(addresses[s.settings_id] == s.address("code") for s in first)
    assert load_suite("bench_engines").parts["first"] == {s.settings_id for s in first}


@pytest.mark.beyond_core
def test_the_frontier_has_every_problem_and_ladders_of_six_settings():
    """A ladder of fewer settings leaves gaps where costs are read between two runs."""
    found = load_suite("frontier").specs
    others = {"random_linkage"}  # an opponent of the referee in suite random: no race is run on it
    assert {s.problem for s in found} == {n for n in registry.problems() if registry.is_own_problem(n)} - others
    ladders = Counter((s.problem, s.solver, str(s.parameters), str(s.options)) for s in found)
    assert min(ladders.values()) >= 6
    assert "dop853_joint" in {s.solver for s in found}
    assert max(s.cpu_limit for s in found) <= 8.0


@pytest.mark.beyond_core
def test_every_contestant_has_the_same_tuning_budget():
    """Eight settings of one scheme or four each of two, over the same span of steps or tolerances, for as much CPU."""
    tuned: dict[tuple[str, str, str], list] = {}
    shipped, taken = Counter(), {}
    for s in load_suite("engine_defaults").specs:
        who = s.problem, s.solver, str(s.options.get("solver", ""))
        if s.label == "tuned":
            tuned.setdefault(who, []).append(s)
        else:
            shipped[who] += 1
        taken.setdefault(s.problem, set()).add((s.solver, str(sorted(s.options.items()))))
    assert {len(specs) for specs in tuned.values()} == {8} and set(shipped.values()) == {1}
    assert {s.cpu_limit for specs in tuned.values() for s in specs} == {10.0}
    for specs in tuned.values():
        schemes = Counter(str(s.options) for s in specs)
        assert sorted(schemes.values()) in ([8], [4, 4])
        values = [s.control.dt or s.control.rtol for s in specs]
        assert (max(values), min(values)) == ((1e-2, 1e-4) if specs[0].control.dt else (1e-3, 1e-11))
    assert {s for _, s, _ in tuned} >= {"rattle", "gc_composed", "rkmk_dop853", "dop853_joint"}
    for pairs in taken.values():
        engines = {solver for solver, _ in pairs if solver in registry.engines()}
        assert len(engines - {"drake_adaptive"}) >= 9
        assert sum(solver in engines for solver, _ in pairs) >= 25


MANY = [k / 1000 for k in range(1, 701)]


@pytest.mark.parametrize(
    ("keys", "count"),
    [
        ("rtol = { from = 0.1, to = 1e-11, per_decade = 1000000000 }", "10,000,000,001"),
        (f"rtol = {MANY}\nmax_step = {MANY}", "490,000"),
        (f"parameters = {{ t_end = {MANY}, omega_z = {MANY} }}\nrtol = 1e-6", "490,000"),
    ],
)
def test_runs_are_counted_before_they_are_made(keys: str, count: str) -> None:
    """A slip of a zero is one line at once, and not a minute without a word or a lack of memory."""
    text = f'[[runs]]\nproblem = "spherical_pendulum"\nsolver = "rk45_strong_form"\n{keys}\n'
    with pytest.raises(FileError, match=f"a suite has at most 200,000 runs .got {count}"):
        parse_suite(text, "many", "many")


@pytest.mark.parametrize("suite", list_suites())
def test_runs_are_counted_as_they_are_made(suite: str) -> None:
    """Sweeps, lists, tuples, two names with one value: of every group of our suites."""
    own = read_source(find_suite_file(suite))
    for group in own.file.runs:
        whole = _add_defaults(group, own.file.defaults)
        assert count_runs(whole) == sum(1 for _ in _expand_group(whole, {}))


def test_a_system_beyond_all_bounds_is_refused_in_words() -> None:
    """Before memory is asked for."""
    for problem, changed in (
        ("chain", {"links": 300_000_000}),
        ("four_bar_grid", {"rows": 100_000, "columns": 100_000}),
    ):
        with pytest.raises(ValueError, match="<= "):
            make_problem(problem, changed)


@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_a_suite_is_a_file(tmp_path, kind: str) -> None:
    """A pipe without a writer would be waited for, a device read without end."""
    place = tmp_path / "odd.toml"
    {"pipe": lambda: os.mkfifo(place), "device": lambda: place.symlink_to("/dev/zero"), "folder": place.mkdir}[kind]()
    whole = tmp_path / "whole.toml"
    whole.write_text('include = ["odd.toml"]\n')
    for named in (place, whole):
        with pytest.raises(FileError, match=rf"cannot read suite .*: (it is a {kind}, not a file|Is a directory)"):
            load_suite(str(named))
