"""Random input of every kind: told in a line or right, never a traceback, never good for nothing.

The same few examples every time; ``FUZZ=2000 python -m pytest tests/harness/test_fuzz.py`` draws so many new ones.
"""

import dataclasses
import hashlib
import json
import math
import os
import time
import tomllib

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from mbsbench import Problem, State, Status
from mbsbench.cli.__main__ import main
from mbsbench.harness.base.files import FileError
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.suites.spec import make_spec
from mbsbench.harness.catalogue.suites.suite import load_suite, parse_suite
from mbsbench.harness.judge.gate.baseline import format_thresholds, read_thresholds
from mbsbench.harness.judge.metrics import measure
from mbsbench.harness.mechanics.consistency import InconsistentStart, check_start, project
from mbsbench.harness.mechanics.system import GROUND, Joint, RigidBody, assemble
from mbsbench.harness.results import store
from mbsbench.harness.results.records import RunRecord, format_record, parse_record_json
from mbsbench.harness.results.series import read_series
from mbsbench.harness.results.words import describe_ending, list_reasons
from mbsbench.harness.run.job import Job
from mbsbench.harness.run.supervisor import Supervisor
from mbsbench.tests.comparing import assert_each
from mbsbench.tests.factories import run_here

DRAWN = int(os.environ.get("FUZZ", "0"))
CALM = {"deadline": None, "derandomize": not DRAWN, "suppress_health_check": list(HealthCheck)}
MORE = settings(max_examples=DRAWN or 60, **CALM)

scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from([10**30, -(10**30), 10**400, 2**63, 1e300]),  # beyond a column, a float, a clock
    st.sampled_from(["free_fall", "exact", "success", "pass", "fail", "equal", "phi_max", "steps", 1e308, -0.0, 0.1]),
)
values = st.recursive(scalars, lambda x: st.lists(x, max_size=3) | st.dictionaries(st.text(max_size=5), x, max_size=3))


def toml(value) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps("" if value is None else value)


def in_a_line(error: Exception) -> bool:
    return bool(str(error)) and "\n" not in str(error)


def told(call, *kinds):
    """What ``call`` gives, or None when it refuses in a line."""
    try:
        return call()
    except kinds as error:
        words = error
    assert in_a_line(words)
    return None


GROUP = {"problem": "free_fall", "solver": "exact", "dt": 0.5}
keys = st.sampled_from(
    [
        "problem",
        "solver",
        "parameters",
        "options",
        "dt",
        "rtol",
        "max_step",
        "max_steps",
        "cpu_limit",
        "memory",
        "repeats",
        "min_time",
        "label",
        "nonsense",
    ]
)


@MORE
@given(st.dictionaries(keys, values, max_size=4), st.sampled_from(["runs", "defaults"]))
def test_suites_are_read_or_refused_in_a_line(change, place):
    """Any value for any key: runs whose steps and limits are finite and positive, or one line."""
    groups = {"runs": dict(GROUP), "defaults": {}}
    groups[place].update(change)
    text = "".join(
        f"{head}\n" + "".join(f"{k} = {toml(v)}\n" for k, v in groups[name].items())
        for head, name in (("[defaults]", "defaults"), ("[[runs]]", "runs"))
    )
    suite = told(lambda: parse_suite(text, "fuzz", "fuzz"), FileError)
    assert suite is None or suite.specs
    for c in suite.specs if suite else ():
        for x in (c.cpu_limit, c.memory, c.repeats, c.control.dt):
            assert math.isfinite(x) and x > 0


heads = st.sampled_from(["name", "description", "include", "total_limit", "plugins", "schema", "runs", "defaults"])
names = st.one_of(
    st.text(max_size=8),
    st.sampled_from(["ci", "paper", "\0", "/", "..", "a/b", "x" * 300, "suite", "base", "self", "ci.toml"]),
)


@MORE
@given(change=st.dictionaries(heads, values | names | st.lists(names, max_size=3), max_size=3))
def test_heads_of_suites_are_read_or_refused_in_a_line(change, tmp_path_factory):
    """Includes of anything, itself too; limits of any kind: a suite with runs and a finite limit, or one line."""
    folder = tmp_path_factory.mktemp("h")
    group = "[[runs]]\n" + "".join(f"{k} = {toml(v)}\n" for k, v in GROUP.items())
    (folder / "base.toml").write_text(group)
    head = "".join(f"{k} = {toml(v)}\n" for k, v in change.items())
    (folder / "self.toml").write_text(head + ("" if "runs" in change else group))
    suite = told(lambda: load_suite(str(folder / "self.toml")), FileError)
    assert suite is None or (suite.specs and (suite.total_limit is None or 0 < suite.total_limit < math.inf))


bound_keys = st.sampled_from(["value", "upper", "lower", "samples", "reason", "expect", "tolerance", "nonsense"])


@MORE
@given(change=st.dictionaries(bound_keys, values, max_size=4))
def test_thresholds_are_read_or_refused_in_a_line(change, tmp_path_factory):
    """What is read can fail, and comes back as written: no bound is lost between."""
    entry = {"value": 1.0, "upper": 2.0, "reason": "r", **change}
    path = tmp_path_factory.mktemp("t") / "t.toml"
    lines = "".join(f"{k} = {toml(v)}\n" for k, v in entry.items())
    path.write_text(f'schema = 2\nsuite = "t"\n[problem.a.bounds."s dt=1".phi_max]\n{lines}')
    read = told(lambda: read_thresholds(path), FileError)
    if read is None:
        return
    (bound,) = read.bounds
    assert not bound.holds(math.nan) and not (bound.holds(math.inf) and bound.holds(-math.inf))
    path.write_text(format_thresholds(read))
    (again,) = read_thresholds(path).bounds
    assert again == bound or math.isnan(bound.value)


GOOD = json.loads(format_record(RunRecord(run_id="abc", case="c", problem="p", solver="s", status="success")))


@MORE
@given(change=st.dictionaries(st.sampled_from(sorted(GOOD)), values, max_size=3))
def test_records_are_read_or_refused(change, tmp_path_factory):
    """A record that is read has the types of its columns, goes back to the same text, and fits into a table."""
    text, path = json.dumps({**GOOD, **change}), tmp_path_factory.mktemp("r") / "abc.json"
    path.write_text(json.dumps({"record": text, "sha256": hashlib.sha256(text.encode()).hexdigest()}))
    record = told(lambda: store.read_record(path), FileError)
    assert record is None or (
        format_record(parse_record_json(format_record(record))) == format_record(record)
        and len(store.table([record])) == 1
    )


@MORE
@given(cut=st.integers(0, 400), flip=st.integers(0, 400), noise=st.binary(max_size=40))
def test_damaged_record_files_are_never_good(cut, flip, noise, tmp_path_factory):
    """Cut, changed or replaced: the digest tells."""
    folder = store.create_folder(tmp_path_factory.mktemp("r"))
    path = store.write_record(folder, RunRecord(run_id="abc", case="c", problem="p", solver="s", status="success"))
    whole = path.read_bytes()
    changed = bytearray(whole[: len(whole) - cut])
    if changed:
        changed[flip % len(changed)] ^= 0x15
    path.write_bytes(bytes(changed) + noise)
    loaded = store.load(folder)
    assert not loaded.records and len(loaded.unreadable) == 1


@MORE
@given(noise=st.binary(max_size=200), text=st.text(max_size=60))
def test_noise_is_no_series_and_no_suite(noise, text, tmp_path_factory):
    for words in (text, noise.decode("latin-1")):
        with pytest.raises(FileError) as error:
            parse_suite(words, "fuzz", "fuzz")
        assert in_a_line(error.value)
    path = tmp_path_factory.mktemp("s") / "x.npz"
    for content in (noise, b"PK\x03\x04" + noise, b"\x93NUMPY" + noise):
        path.write_bytes(content)
        with pytest.raises(FileError):
            read_series(path)


words = st.one_of(
    st.text(st.characters(blacklist_categories=("Cs",), blacklist_characters="\0"), max_size=10),
    st.sampled_from(["nan", "inf", "-1", "0", "1e400", "0x1", "1_0", "true", "[]", "dt", "1e-320", "٣", "½"]),
)


@MORE
@given(value=words, flag=st.sampled_from(["--solver", "--status", "--sort", "--limit", "--label"]))
def test_filters_of_show_are_reported_in_one_line(value, flag, capsys, tmp_path_factory):
    """Whatever is asked of a run of one run: a table, or one line and exit code 2."""
    folder = store.create_folder(tmp_path_factory.mktemp("w"))
    store.write_record(folder, RunRecord(run_id="abc", case="c", problem="p", solver="s", status="success"))
    code = main(["show", str(folder), f"{flag}={value}"])
    out, err = capsys.readouterr()
    assert (code == 0 and "1 run" in out and not err) or (code == 2 and err.count("\n") == 1 and not out)


@MORE
@given(key=st.sampled_from(["dt", "max_steps", "cpu_limit", "lift", "rtol"]) | words, value=words, mass=words)
def test_values_on_the_command_line_are_reported_in_one_line(key, value, mass, capsys, tmp_path_factory):
    """Exit code 2, one line, nothing written; only numbers that make sense get any further."""
    folder = tmp_path_factory.mktemp("c") / "gone"
    line = ["solve", "free_fall", "exact", "--out", str(folder / "x.npz")]
    code = main([*line, f"--set={key}={value}", f"--problem-set=mass={mass}"])
    out, err = capsys.readouterr()
    assert code == 2 and err.count("\n") == 1 and err.startswith("error: ") and not out and not folder.exists()


masses = st.sampled_from([1e-6, 1e-3, 1.0, 1e3, 1e6])


@st.composite
def mechanisms(draw):
    """One to four bodies in a tree of joints, then loops and doubled joints; masses over twelve decades."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    nb = draw(st.integers(1, 4))
    mass = [draw(masses) for _ in range(nb)]
    bodies = [RigidBody(m, np.diag(m * rng.uniform(0.5, 0.9, 3))) for m in mass]
    r = np.cumsum(rng.uniform(0.2, 0.6, (nb, 3)), axis=0)
    pairs = [(b, draw(st.integers(-1, b - 1))) for b in range(nb)]
    pairs += draw(st.lists(st.tuples(st.integers(0, nb - 1), st.integers(-1, nb - 1)), max_size=2))  # loops, doubles
    joints = []
    for k, (i, j) in enumerate(pairs):
        if i == j:
            continue
        at = r[i] + rng.uniform(-0.3, 0.3, 3) if k < nb else r[i]
        axis = tuple(rng.normal(size=3)) if draw(st.booleans()) else None
        arm = (at if j == GROUND else at - r[j]).tolist()
        joints.append(Joint(i, (at - r[i]).tolist(), j=j, s_j=arm, axis_i=axis, axis_j=axis))
    system = assemble(bodies, joints, (0.0, 0.0, -9.81))
    spin = np.zeros((nb, 3)) if len(joints) > nb else rng.normal(size=(nb, 3))
    start = State(r, np.broadcast_to(np.eye(3), (nb, 3, 3)), np.zeros((nb, 3)), spin)
    return Problem("random", system, start, t_end=0.05, dt=0.005, section="", source="drawn")


def movable(problem):
    """With the start made consistent, or None where that is refused: a loop that cannot turn as drawn."""

    def consistent():
        state = project(problem.system, problem.initial)
        check_start(problem.system, state)
        return dataclasses.replace(problem, initial=state)

    return told(consistent, InconsistentStart, ValueError)


@pytest.mark.slow
@settings(max_examples=DRAWN or 25, **CALM)
@given(problem=mechanisms(), solver=st.sampled_from(["gc_augmented_lagrangian", "ida_index1", "rk45_strong_form"]))
def test_random_mechanisms_have_no_wrong_success(problem, solver, tmp_path_factory):
    """Whatever is drawn ends as a status; a success keeps energy and constraints to what the method can.

    The suite ``random`` puts 360 mechanisms before their references; here a few of another generator.
    """
    if (problem := movable(problem)) is None:
        return
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "make_problem", lambda name, parameters=None: problem)
        patch.setattr(measure, "find_reference", lambda problem: None)  # laws alone: a reference takes up to a minute
        spec = make_spec(problem, solver, None, {}, cpu_limit=20.0)
        folder = store.create_folder(tmp_path_factory.mktemp("m"))
        record = run_here(Job(spec, folder))
    assert record.status in set(Status) and (describe_ending(record) or Status(record.status).lawful)
    assert record.status != Status.CRASHED, record.message
    if record.status == Status.SUCCESS:
        assert record.t_reached_s == problem.t_end
        assert record.phi_max < 1e-2 * record.length_scale_m
        assert record.energy_drift_max_J < 0.1 * record.energy_scale_J
    series = store.read_run_series(folder, record)
    if series is not None:
        assert_each(np.diff(series["t"]), ">", 0.0)


SIX = ("gc_weak_form", "gc_augmented_lagrangian", "rk45_strong_form", "ndf_index1", "ida_index1", "ida_index3")
FINE = {"dt": {"dt": 5e-4}, "rtol": {"rtol": 1e-8}}
AGREE = 1e-3  # of the length, after 0.05 s: bodies of a millionth of another's mass may turn at 100 rad/s


@pytest.mark.slow
@settings(max_examples=DRAWN or 40, phases=(Phase.explicit, Phase.generate), **CALM)  # shrinking takes minutes
@given(problem=mechanisms())
def test_random_mechanisms_move_alike_in_all_solvers(problem, tmp_path_factory):
    """Each solver in a process of its own, as in runs: no crash, no hang; those that claim success agree."""
    if (problem := movable(problem)) is None:
        return
    folder = store.create_folder(tmp_path_factory.mktemp("m"))
    supervisor, ended = Supervisor(), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "make_problem", lambda name, parameters=None: problem)
        for solver in SIX:
            control = FINE[registry.solvers()[solver].control]
            supervisor.start(Job(make_spec(problem, solver, None, control, cpu_limit=40.0), folder))
            until = time.monotonic() + 60.0
            while supervisor.running and time.monotonic() < until:
                ended += list(supervisor.step())
            assert not supervisor.running, f"{solver} hangs"
    records = store.load(folder).records
    assert len(records) == len(SIX) == len(ended) and not any(e.error for e in ended)
    size = max(r.length_scale_m for r in records if r.status == Status.SUCCESS) if records else 1.0
    ends = {}
    for r in records:
        assert r.status != Status.CRASHED, f"{r.case}: {r.message}"
        assert r.status == Status.SUCCESS or list_reasons(r)
        if r.status == Status.SUCCESS:
            ends[r.solver] = store.read_run_series(folder, r)["end_r"]
    for solver, end in ends.items():
        gap = np.max(np.abs(end - next(iter(ends.values()))))
        assert gap < AGREE * size, f"{solver} is {gap:.3g} m off"


def test_toml_of_the_fuzzer_is_toml():
    """Else it would only test the parser's complaint."""
    value = {"a": [1.5, "x\n", {"b": True}], "c": math.inf}
    assert tomllib.loads(f"v = {toml(value)}")["v"] == value
