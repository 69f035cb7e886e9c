"""Between two stored poses of a long step the page draws the run's motion, or nothing; never another motion."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbsbench.reports.mechanism.theatre.poses import Poses, fill_gaps, interpolate_poses
from mbsbench.reports.mechanism.theatre.scene import collect_players, make_scene
from mbsbench.reports.model.results import read_results
from mbsbench.tests.factories import make_measured_record

from ..conftest import put
from .conftest import about_z, held

RATE, T_END = 3.0, 20.0
AXIS = np.array([0.48, 0.6, 0.64])  # no axis of the frame


def spin(t: np.ndarray, off: float = 0.0) -> Poses:
    """A turn of ``RATE`` about ``AXIS``, ``off`` [rad] ahead at the end, its centre on a line."""
    q = Rotation.from_rotvec((RATE * t + off * t / T_END)[:, None] * AXIS).as_quat()[:, None]
    return Poses(t, (np.outer(t, [0.1, 0.0, 0.0]) + off * np.outer(t / T_END, [0.0, 0.0, 0.01]))[:, None], q)


def angle(a: Poses, b: Poses) -> float:
    """The largest [rad] between the first bodies at the same times."""
    return float(np.max((Rotation.from_quat(a.q[:, 0]).inv() * Rotation.from_quat(b.q[:, 0])).magnitude()))


@pytest.mark.parametrize("off", [0.0, 0.2])
@pytest.mark.parametrize("samples", [400, 30])  # the exact motion turns by 0.15 and by 2.07 rad between two of them
def test_a_long_step_is_filled_with_the_exact_motion_and_the_runs_own_error(off, samples):
    """Three poses of ten turns: what is drawn is the run's own motion, its error growing evenly from pose to pose."""
    exact, fine = np.linspace(0.0, T_END, samples), np.linspace(0.0, T_END, 3001)
    stored = np.array([0.0, 6.0 * np.pi / RATE, T_END])  # after whole turns: at rest, for who looks at stored poses
    poses, added, unknown = fill_gaps(spin(stored, off), spin(exact), 1.0)
    assert angle(interpolate_poses(spin(stored, off), fine), spin(fine, off)) > 3.0  # the great circle alone
    assert angle(interpolate_poses(poses, fine), spin(fine, off)) < 1e-6 and not unknown
    assert added == len(poses) - 3 == samples - 2
    assert np.max(np.abs(interpolate_poses(poses, fine).r - spin(fine, off).r)) < 1e-9


def test_where_the_error_is_large_a_long_gap_is_unknown():
    """Two radians off: nobody can tell how the run turned between; a short gap is none, whatever the error."""
    exact, stored = spin(np.linspace(0.0, T_END, 400)), np.array([0.0, 2.0, 11.0, 11.1, T_END])
    _, added, unknown = fill_gaps(spin(stored, 20.0), exact, 1.0)
    assert unknown == ((0.0, 2.0), (2.0, 11.0), (11.1, T_END)) and added == 0


def test_poses_that_are_near_stay_as_they_are():
    t = np.linspace(0.0, T_END, 2000)
    _, added, unknown = fill_gaps(spin(t, 0.2), spin(t[::5]), 1.0)
    assert added == 0 and not unknown


def test_the_page_holds_the_motion_of_a_long_step(tmp_path):
    """From the series file to the packed poses: 40 rad between two stored poses, the exact motion beside them."""
    motion = held(RATE, (-0.5, 0.0, 0.0), n=400, t_end=T_END)
    exact = {f"exact_{k}": motion[f"frame_{k}"] for k in ("t", "r", "q")}
    for k in ("frame_t", "frame_r", "frame_q"):
        motion.arrays[k] = motion[k][[0, 266, 399]]
    motion.arrays.update(exact)
    put(tmp_path, make_measured_record("aa01", t_end_s=T_END), motion)
    (variant,) = (results := read_results(tmp_path)).variants
    cast, _, _ = collect_players(results, variant)
    (player,) = make_scene(variant, cast, {"alpha": type("Look", (), {"colour": "#123456"})})[0]["players"]
    rows = np.asarray(player["poses"]).reshape(7, player["frames"]).T - 32767
    q = rows[:, 3:] / np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    drawn = interpolate_poses(Poses(player["t"], np.zeros((len(q), 1, 3)), q[:, None]), exact["exact_t"])
    truth = Poses(exact["exact_t"], drawn.r, about_z(RATE * exact["exact_t"])[:, None])
    assert angle(drawn, truth) < 0.04  # 0.03 rad, and rounding to 16 bits
    assert player["stored"] == 3 and player["added"] > 100
