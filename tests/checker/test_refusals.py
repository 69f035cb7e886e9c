"""Bundles of one honest motion, each edited in one way that would turn laws off: the checker names the edit."""

import io
import json
from pathlib import Path

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue.registry import load_plugin
from mbsbench.harness.results import store
from mbsbench.tests.factories import specify_run, store_run

from .test_check_bundle import check, checker, read, write
from .test_forged_motions import PARAMETERS, of_vector

HANGING = {"angle": -90.0, "t_end": 0.1}


def make_bundle(place, parameters):
    """The files of a lossless bundle of one honest pendulum."""
    load_plugin(Path(__file__).parent / "forged.py")
    folder = store.create_folder(place / "results")
    store_run(folder, specify_run("spherical_pendulum", "forged", parameters, dt=2e-3))
    assert main(["bundle", str(folder), "-o", str(place / "b.zip"), "--lossless"]) == 0
    return read(place / "b.zip")


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    """A pendulum that swings."""
    return make_bundle(tmp_path_factory.mktemp("honest"), PARAMETERS)


@pytest.fixture(scope="module")
def hanging(tmp_path_factory):
    """A pendulum that hangs still."""
    return make_bundle(tmp_path_factory.mktemp("hanging"), HANGING)


def edit(bundle, change):
    """The files after ``change`` of the record, the run and the problem."""
    (record,), (run,) = json.loads(bundle["records.json"]), json.loads(bundle["runs.json"])
    name = f"problems/{run['problem']}.json"
    problem = json.loads(bundle[name])
    change(record, run, problem)
    parts = {"records.json": [record], "runs.json": [run], name: problem}
    return bundle | {key: json.dumps(part).encode() for key, part in parts.items()}


def edit_matrix(bundle, folder, change):
    """The files after ``change`` of the matrix in a folder, of a row a number and a column a state."""
    (name,) = (name for name in bundle if name.startswith(folder))
    stream = io.BytesIO()
    np.lib.format.write_array(stream, change(np.load(io.BytesIO(bundle[name]))), version=(1, 0))
    return bundle | {name: stream.getvalue()}


def drop_scales(record, run, problem):
    run["peaks_s"] = {key: at for key, at in run["peaks_s"].items() if "scale " not in key}


def inflate(record, run, problem):
    """Scales as of a motion that is far larger."""
    record.update(length_scale_m=1e12, speed_scale_m_per_s=1e12, energy_scale_J=1e30)


def rename(record, run, problem):
    run["arrays"]["dt2"] = run["arrays"].pop("dt")


def cut(record, run, problem):
    at, (count,) = run["arrays"]["dt"]
    run["arrays"] |= {"dt": [at, [count - 1]], "diag_x": [at + count - 1, [1]]}


def turn_energy_off(record, run, problem):
    """A drive of the frequency 1 rad/s and the amplitude 0, on a joint that is not driven."""
    problem["numbers"]["joint_motion"] = [[0, 0, 0, 0, 0, 1, 0]]
    record["energy_drift_max_J"] *= 0.5


def describe(**more):
    def change(record, run, problem):
        problem["invariants"][0] |= {"quantity": "momentum", "along": [1.0, 0.0, 0.0], **more}

    return change


EDITS = {  # what is edited, and what the checker must name
    "another first break": (lambda record, run, problem: run["peaks_s"].update({"x:first": -1.0}), ":first"),
    "a law broken by a success": (
        lambda record, run, problem: run["peaks_s"].update({"energy_share_max:first": 0.1}),
        "status: a law is broken",
    ),
    "no states that set scales": (drop_scales, "scales kept"),
    "a share of energy": (lambda record, run, problem: record.update(energy_share_max=77.0), "energy_share_max"),
    "a maximum left out": (lambda record, run, problem: record.pop("phi_max"), "phi_max"),
    "an error left out": (lambda record, run, problem: record.pop("position_error_max_m"), "position_error_max"),
    "an integer for an error": (lambda record, run, problem: record.update(rate_error_judged_m_per_s=0), "rate_error"),
    "a series left out": (rename, "series listed"),
    "a series cut short": (cut, "series lengths"),
    "a drive without effect": (turn_energy_off, "energy_drift_max_J"),
    "a damper on a joint": (lambda record, run, problem: problem["numbers"].update(joint_c=[1.0]), "joint_c"),
    "a success at its limit": (lambda record, run, problem: record.update(ended_by="cpu_limit"), "ended_by"),
    "a suspended success": (lambda record, run, problem: record.update(ended_by="suspended"), "ended_by"),
    "an unknown quantity": (describe(quantity="luck"), "invariant L_Y"),
    "a direction of length 0": (describe(along=[0.0, 0.0, 0.0]), "invariant L_Y"),
    "a size that is no number": (lambda record, run, problem: record.update(reaction_size_N="nan"), "status"),
    "an inertia below 0": (
        lambda record, run, problem: problem["numbers"].update(inertia=[np.diag([-0.1, 1.0, 1.0]).tolist()]),
        "inertia",
    ),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("what", EDITS)
def test_an_edit_that_turns_a_law_off_is_named(bundle, tmp_path, what):
    change, named = EDITS[what]
    assert check(write(tmp_path / "b.zip", bundle)) == []
    found = [line[18:56] for line in check(write(tmp_path / "c.zip", edit(bundle, change)))]
    assert any(line.startswith(named) for line in found), found


@pytest.mark.parametrize("how", ["far", "hanging"])
def test_scales_of_rest_are_computed(bundle, hanging, tmp_path, how):
    """A run that goes 1e7 m off makes no motion a rest; and at rest recorded scales are no matter of choice."""
    files = hanging
    if how == "far":

        def change(matrix):
            matrix[1, 5:-5] += 1e7
            return matrix

        files = edit_matrix(bundle, "runs/", change)
    columns = ("length_scale_m", "speed_scale_m_per_s", "energy_scale_J")
    honest = [line for line in check(write(tmp_path / "b.zip", files)) if line[18:56].startswith(columns)]
    assert honest == []
    found = [line[18:56].strip() for line in check(write(tmp_path / "c.zip", edit(files, inflate)))]
    assert set(columns) <= set(found)


def test_a_pendulum_that_hangs_still_is_accepted_and_called_at_rest(hanging, tmp_path):
    """Longer arms would call any motion rest, and its limits would be theirs: a reader is told of each."""
    with np.errstate(all="ignore"):
        report = checker.Report(write(tmp_path / "b.zip", hanging))
    assert report.findings == []
    assert "that stay at rest: within 1e-6 of their longest arm, which is their length" in report.weak


REFUSED = {  # matrices that are none of the problem: folder, change
    "no exact state": ("references/", lambda matrix: matrix[:, :0]),
    "another body in the states": ("runs/", lambda matrix: np.vstack([matrix, matrix[1:19]])),
    "a number less in the states": ("runs/", lambda matrix: matrix[:-1]),
    "a time that is no number": (
        "runs/",
        lambda matrix: np.where(np.arange(len(matrix))[:, None] == 0, np.nan, matrix),
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_matrix_that_is_none_is_refused(bundle, tmp_path, what):
    files = edit_matrix(bundle, *REFUSED[what])
    with pytest.raises(ValueError, match=r"states of|times not in order"):
        check(write(tmp_path / "b.zip", files))


def test_a_reference_without_a_horizon_is_refused(bundle, tmp_path):
    files = edit(bundle, lambda record, run, problem: problem["reference"].update(horizon_s="nan"))
    with pytest.raises(ValueError, match="without a horizon"):
        check(write(tmp_path / "b.zip", files))


def test_all_that_is_owed_is_owed_by_lossless_bundles_alone(bundle, tmp_path):
    """A bundle that calls itself thinned owes the ladder no less."""
    head = json.loads(bundle["bundle.json"]) | {"lossless": False}
    (run,) = json.loads(bundle["runs.json"])
    files = {name: raw for name, raw in bundle.items() if not name.startswith("series/")}
    files |= {"bundle.json": json.dumps(head).encode(), "runs.json": json.dumps([run | {"arrays": {}}]).encode()}
    path = write(tmp_path / "b.zip", files)
    assert check(path) == []
    with np.errstate(all="ignore"):
        (found,) = checker.Report(path, complete=True).findings
    assert "lossless" in found


def test_reactions_that_are_no_numbers_are_counted_in_words(bundle, tmp_path):
    """They are judged nowhere but at the instants that the run names."""
    (run,) = json.loads(bundle["runs.json"])
    files = dict(bundle)
    at = [round(run["peaks_s"][column] / 2e-3) for column in run["reactions"]]

    def hide(rows):
        rows = rows.copy()
        rows[[k for k in range(len(rows)) if k not in at]] = np.nan
        return rows

    of_vector(files, run, hide)
    with np.errstate(all="ignore"):
        report = checker.Report(write(tmp_path / "b.zip", files))
    assert report.findings == [] and "with reactions that are no numbers at some steps" in report.weak


def test_half_a_turn_has_an_axis():
    """Its sine is 0, or rounding: the axis is that of the symmetric part."""
    axis = np.array([1.0, 2.0, 2.0]) / 3
    for off in (0.0, 1e-15, 1e-9, 1e-3, 0.4, 0.5):
        vector = (np.pi - off) * axis
        with np.errstate(all="ignore"):
            assert checker.log(checker.exp(vector[None])).real[0] == pytest.approx(vector, abs=1e-14)
    assert np.abs(checker.log(np.diag([1.0, -1.0, -1.0])).real) == pytest.approx([np.pi, 0.0, 0.0])


def make_hinges(kinds=("hinge", "hinge"), **more):
    """The checker's problem of two bodies that hinges, or other kinds, hold at the ground, without an exact motion."""
    sizes = {"body": 2, "user": 0, "joint": 2}
    numbers = {key: np.zeros([sizes.get(axis, axis) for axis in axes]) for key, axes in checker.SHAPES.items()}
    x, _, z = np.eye(3)
    numbers |= {"mass": np.ones(2), "inertia": np.tile(np.eye(3), (2, 1, 1)), "gyration": np.full(2, 1.3)}
    numbers |= {"start_R": np.tile(np.eye(3), (2, 1, 1)), "joint_i": np.arange(2.0), "joint_j": np.full(2, -1.0)}
    numbers |= {"joint_u": np.tile(z, (2, 1)), "joint_w": np.tile(x, (2, 1)), "joint_n": np.tile(np.eye(3), (2, 1, 1))}
    numbers |= {"joint_points": np.full(2, 3.0), "joint_axes": np.full(2, 3.0), **more}
    head = {"t_end_s": 1.0, "literal_start": False, "not_serialised": [], "invariants": []}
    head |= {"joint_kinds": kinds, "reference": {"route": "", "horizon_s": 0.0}}
    head["numbers"] = {key: np.asarray(a).tolist() for key, a in numbers.items()}
    return checker.Problem(head, None, "hinges")


def test_a_joint_turned_over_about_either_axis_is_found():
    """About n1 u is the other way, about n3 w is; about n2 both. No row reads n3, so bundles have 0 there."""
    turns = (([0, 0, 0], 0, 0), ([1, 0, 0], 1, 0), ([0, 1, 0], 1, 1), ([0, 0, 1], 0, 1))
    for p in (make_hinges(), make_hinges(joint_n=np.tile(np.diag([1.0, 1.0, 0.0]), (2, 1, 1)))):
        for vector, reversed_u, half_turned in turns:
            state = p.start.copy()
            state[0, 4:13] = checker.exp(np.pi * np.array(vector, float)).ravel()
            assert p.find_reversed_joints(state).sum() == reversed_u
            assert p.find_rows(state)[2].sum() == half_turned


def test_only_what_has_an_effect_does_work():
    """Numbers of a drive, a damper or a load that change nothing are no reason to take energy as stated."""
    still, sine = np.zeros((2, 7)), np.zeros((2, 7))
    still[0, 5], sine[1, 4:6] = 1.0, 1.0
    cases = (
        ("hinge", {"joint_motion": sine}, False),
        ("driven angle", {"joint_motion": still}, False),
        ("driven angle", {"joint_motion": sine}, True),
        ("load", {"joint_motion": sine}, True),
        ("load", {"joint_motion": sine, "joint_u": np.zeros((2, 3)), "joint_w": np.zeros((2, 3))}, False),
        ("spring", {"joint_c": np.array([0.0, 1.0])}, True),
    )
    for kind, more, works in cases:
        p = make_hinges((kind, kind), joint_moving=np.full(2, float(kind != "hinge")), **more)
        assert p.has_work == works, (kind, more)
        assert p.does_work(np.array([True, False])) is False
        assert p.does_work(np.array([False, True])) is works


def test_a_mechanism_without_work_is_judged_beside_one_with_it():
    """The first of two bodies gains energy that nothing gives it; a spring with a damper holds the second."""
    numbers = {"joint_moving": np.array([0.0, 1.0]), "joint_points": np.array([3.0, 0.0])}
    numbers |= {"joint_axes": np.array([3.0, 0.0]), "joint_c": np.array([0.0, 1.0]), "start_Omega": np.ones((2, 3))}
    p = make_hinges(("hinge", "spring"), **numbers)
    states = np.repeat(p.start, 2, axis=0)
    states[1, 0], states[1, 16:19] = 1.0, 2.0
    first, second = (p.find_scales(states, np.inf, True, part)[0]["energy"] for part in np.eye(2, dtype=bool))
    assert first[1] == pytest.approx(0.5 * 3 * (4 - 1)) and second[1] == 0.0
