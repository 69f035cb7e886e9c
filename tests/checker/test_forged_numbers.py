"""Numbers that no row of phi binds, that are no numbers, or that are words: the checker names each one forged."""

import io
import json

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.results import store
from mbsbench.tests.factories import specify_run, store_run

from .test_check_bundle import check, checker, read, write
from .test_refusals import PARAMETERS, edit, edit_matrix, make_bundle

MIRROR = np.diag([1.0, 1.0, -1.0])


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    """A pendulum that swings."""
    return make_bundle(tmp_path_factory.mktemp("honest"), PARAMETERS)


@pytest.fixture(scope="module")
def hinged(tmp_path_factory):
    """A slider and a crank on hinges, a line and a drive."""
    place = tmp_path_factory.mktemp("hinged")
    folder = store.create_folder(place / "results")
    store_run(folder, specify_run("driven_slider_crank", "rk45_strong_form", {"t_end": 0.05}, rtol=1e-8))
    assert main(["bundle", str(folder), "-o", str(place / "b.zip"), "--lossless"]) == 0
    return read(place / "b.zip")


def scale(**factors):
    """A change of numbers of the joints by factors."""

    def change(record, run, problem):
        for key, factor in factors.items():
            name = f"joint_{key}"
            problem["numbers"][name] = (factor * np.array(problem["numbers"][name])).tolist()

    return change


def put(**numbers):
    """A change of numbers of the problem to others."""
    return lambda record, run, problem: problem["numbers"].update(numbers)


def add_joint(record, run, problem):
    """A joint without rows, of arms of 1 km, at the ground."""
    numbers = problem["numbers"]
    for key, axes in checker.SHAPES.items():
        if axes[0] == "joint":
            numbers[key].append(np.zeros(axes[1:]).tolist())
    numbers["joint_s_j"][-1], numbers["joint_j"][-1] = [1e3, 0.0, 0.0], -1
    problem["joint_kinds"].append("spherical")
    problem["joint_names"].append("none")


def mirror_frame(record, run, problem):
    problem["numbers"]["frame"] = (np.array(problem["numbers"]["frame"]) @ MIRROR).tolist()


def mirror_start(record, run, problem):
    problem["numbers"]["start_R"] = (np.array(problem["numbers"]["start_R"]) @ MIRROR).tolist()


def end_beside(record, run, problem):
    """An end a rounding after the last state, and a gap there that no state has."""
    record.update(t_reached_s=float(np.nextafter(record["t_reached_s"], 1e9)), phi_end=99.0)


def judge_beside(record, run, problem):
    """A horizon 1e-7 before the state that it is of, and an error without that state."""
    at = record["judged_to_s"] * (1.0 - 1e-7)
    record.update(judged_to_s=at)
    run["peaks_s"]["judged_to_s"] = at


EDITS = {  # what is forged, and what the checker must name
    "a stiffness of a joint": (put(joint_k=[1e9]), "joint_k"),
    "a joint without rows": (add_joint, "joint without rows"),
    "a frame that mirrors": (mirror_frame, "frame"),
    "a start that mirrors": (mirror_start, "start_R"),
    "a gyration of a kilometre, beside which any motion is rest": (put(gyration=[1e3]), "gyration"),
    "a unit of another quantity": (
        lambda record, run, problem: problem["invariants"][0].update(unit="J"),
        "invariant L_Y",
    ),
    "an inertia of no matter": (put(inertia=[np.diag([1.0, 1.0, 3.0]).tolist()]), "inertia"),
    "a claim of no status": (lambda record, run, problem: record.update(status="well", claimed="well"), "claimed"),
    "a claimed inaccuracy": (
        lambda record, run, problem: record.update(status="inaccurate", claimed="inaccurate"),
        "claimed",
    ),
    "an end by no cause": (
        lambda record, run, problem: record.update(status="crashed", claimed="", ended_by="luck", counters="{}"),
        "ended_by",
    ),
    "a length of 0": (lambda record, run, problem: record.update(length_scale_m=0.0), "length above 0"),
    "a gyration behind a length that its joint does not read": (
        put(gyration=[1e9], joint_length=[1e9], inertia=np.zeros((1, 3, 3)).tolist()),
        "gyration",
    ),
    "an end beside the last state, where nothing is compared": (end_beside, "t_reached_s"),
    "a horizon of judging beside a state": (judge_beside, "judged_to_s"),
    "an exact motion under another gravity": (put(gravity=[0.0, -19.62, 0.0]), "reference: equations"),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("what", EDITS)
def test_a_forged_number_is_named(bundle, tmp_path, what):
    change, named = EDITS[what]
    assert check(write(tmp_path / "b.zip", bundle)) == []
    found = [line[18:56] for line in check(write(tmp_path / "c.zip", edit(bundle, change)))]
    assert any(line.startswith(named) for line in found), found


DIRECTIONS = {  # factors of joints, and what the checker must name
    "longer and shorter": ({"u": 2.0, "n": 0.5}, "joint_n"),
    "normals of a millionth": ({"n": 1e-6}, "joint_n"),
    "axes of a millionth": ({"u": 1e-6}, "joint_u"),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("what", DIRECTIONS)
def test_directions_have_length_1(hinged, tmp_path, what):
    """Rows of shorter ones would make the same joints, of smaller gaps."""
    factors, named = DIRECTIONS[what]
    assert check(write(tmp_path / "b.zip", hinged)) == []
    found = [line[18:56].strip() for line in check(write(tmp_path / "c.zip", edit(hinged, scale(**factors))))]
    assert named in found


def test_a_drive_without_effect_sets_no_step(bundle, tmp_path):
    """A frequency of 1e12 rad/s of the amplitude 0 leaves accelerations as they are."""
    files = edit(bundle, put(joint_motion=[[0, 0, 0, 0, 0, 1e12, 0]]))
    assert check(write(tmp_path / "b.zip", files)) == []


def test_mirrored_bodies_are_found(bundle, tmp_path):
    """R^T R is 1 for them, too; of flat bodies no distance tells."""

    def mirror(matrix):
        matrix[4:13] = (matrix[4:13].T.reshape(-1, 3, 3) @ MIRROR).reshape(-1, 9).T
        return matrix

    found = [line[18:56].strip() for line in check(write(tmp_path / "b.zip", edit_matrix(bundle, "runs/", mirror)))]
    assert "mirrored bodies" in found


REFUSED = {  # what is no bundle at all, and how it is called
    "half a body": (put(joint_i=[0.5]), "beyond the bodies"),
    "a horizon of 0": (
        lambda record, run, problem: problem["reference"].update(horizon_s=0.0),
        "without a horizon",
    ),
    "a negative shape": (lambda record, run, problem: run["arrays"].update(diag_x=[0, [-1]]), "not in its place"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_no_bundle_is_refused(bundle, tmp_path, what):
    change, words = REFUSED[what]
    with pytest.raises(ValueError, match=words):
        check(write(tmp_path / "b.zip", edit(bundle, change)))


def test_a_bundle_of_no_run_is_found(bundle, tmp_path):
    kept = ("runs/", "series/", "problems/", "references/")
    files = {name: raw for name, raw in bundle.items() if not name.startswith(kept)}
    head = json.loads(files["bundle.json"]) | {"codes": []}
    files |= {"bundle.json": json.dumps(head).encode(), "table.json": b"[]"}
    (found,) = check(write(tmp_path / "b.zip", files | {"records.json": b"[]", "runs.json": b"[]"}))
    assert found.split()[:2] == ["bundle", "runs"]


def test_no_number_hides_the_least_time(bundle):
    """The first of two successes has no CPU time."""
    one = {"status": "success", "length_scale_m": 1.0, "motion_error_judged_m": 0.0}
    cells = checker.Report.count_cells(None, [one | {"cpu_median_s": "nan"}, one | {"cpu_median_s": 2.0}])
    assert cells["least_cpu_s"] == 2.0


def test_cpu_times_without_that_of_their_process_are_counted_in_words(bundle, tmp_path):
    words = "whose CPU times no time of their process bounds"
    with np.errstate(all="ignore"):
        known = {"cpu_min_s": 1.0, "cpu_median_s": 1.0, "cpu_max_s": 1.0, "cpu_process_s": "nan", "repeats": 3}
        files = edit(bundle, lambda record, run, problem: record.update(cpu_q1_s="nan", cpu_q3_s="nan", **known))
        assert words in checker.Report(write(tmp_path / "b.zip", files)).weak


def widen(bundle, change):
    """The files with an exact state more, between the first two, that ``change`` made of their mean."""

    def insert(matrix):
        extra = change(matrix[:, :2].mean(axis=1))
        return np.insert(matrix, 1, extra, axis=1)

    return edit_matrix(bundle, "references/", insert)


def rush(state):
    """Velocities of 1 km/s."""
    state[13:16] = 1e3
    return state


def doubt(state):
    """A stated error of a twentieth of the arm."""
    state[-1] = 0.05
    return state


def leap(state):
    """A pose that a second at its speed would not reach."""
    state[1:4] += 10.0
    return state


EXACT = {
    "beside all steps": (rush, "reference: times"),
    "of a large error": (doubt, "reference: errors that fall"),
    "far from its neighbours": (leap, "reference: pace"),
}


@pytest.mark.parametrize("what", EXACT)
def test_exact_states_that_no_step_is_compared_with_set_no_scale(bundle, tmp_path, what):
    change, named = EXACT[what]
    found = [line[18:56].strip() for line in check(write(tmp_path / "b.zip", widen(bundle, change)))]
    assert named in found and "reference: times" in found


def test_a_motion_compared_with_nothing_is_counted_in_words(bundle, tmp_path):
    """From the second step on the stated error is a hundredth of the arm."""

    def raise_errors(matrix):
        matrix[-1, 1:] = 0.01
        return matrix

    with np.errstate(all="ignore"):
        files = edit(bundle, lambda record, run, problem: record.update(judged_to_s=0.0))
        report = checker.Report(write(tmp_path / "b.zip", edit_matrix(files, "references/", raise_errors)))
    assert "compared with an exact motion at fewer than three steps" in report.weak
    assert "compared with an exact motion for under half of their time" in report.weak


def test_an_exact_motion_that_is_far_faster_is_counted_in_words(bundle, tmp_path):
    """One exact state, by which every limit of velocities is a thousand times as wide."""

    def rush_once(matrix):
        matrix[13:16, -1] *= 1e3
        return matrix

    with np.errstate(all="ignore"):
        report = checker.Report(write(tmp_path / "b.zip", edit_matrix(bundle, "references/", rush_once)))
    assert "whose exact motion goes ten times as far or as fast" in report.weak


def test_a_step_longer_than_asked_for_is_counted_in_words(bundle, tmp_path):
    files = edit(bundle, lambda record, run, problem: record.update(dt_s=1.2e-3))
    with np.errstate(all="ignore"):
        assert (
            "with a step longer than the fixed step asked for" in checker.Report(write(tmp_path / "b.zip", files)).weak
        )


def test_ratios_that_nothing_determines_say_so():
    """Neither 0 nor no number passes for a law that holds."""
    ones = np.ones((3, 1))
    with np.errstate(all="ignore"):
        assert checker.find_ratio(ones[:2], ones[:2]) == checker.find_ratio(np.nan * ones, ones) == -1.0
        assert checker.find_ratio(1e308 * ones, 1e308 * ones) == np.inf
        assert checker.find_ratio(ones, 2.0 * ones) == 0.5


def test_a_drift_in_a_unit_without_a_scale_is_undecided(bundle, tmp_path):
    """A swing changes its momentum from 0; in N s nothing says what is much."""
    ((_, states),) = ((name, np.load(io.BytesIO(bundle[name]))) for name in bundle if name.startswith("runs/"))

    def state_momentum(record, run, problem):
        found = problem["numbers"]["mass"][0] * states[13]
        off = found - found[0]
        assert found[0] == 0.0 and np.abs(off).max() > 0.0
        about = {"quantity": "momentum", "along": [1.0, 0.0, 0.0], "unit": "N s"}
        problem["invariants"] = [problem["invariants"][0] | about]
        name = problem["invariants"][0]["name"]
        drift = {"start": found[0], "end": off[-1], "max": np.abs(off).max(), "unit": "N s"}
        record["invariant_drifts"] = json.dumps({name: drift})

    with np.errstate(all="ignore"):
        seen = checker.Report(write(tmp_path / "b.zip", edit(bundle, state_momentum)))
    assert ("its unit has no scale", "invariant L_Y") in seen.undecided, seen.undecided
