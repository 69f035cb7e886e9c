"""The view of a motion on paper: a planar one from the front, a spatial one at an angle."""

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from mbsbench.harness.catalogue import registry
from mbsbench.reports.mechanism.segments import mechanism_of
from mbsbench.reports.mechanism.view import flat, view_of

from .conftest import series_for


def turning(t_end: float = 2.0, n: int = 81):
    """A pendulum that turns once about OZ in two seconds, as a series file."""
    still = series_for(registry.make_problem("spherical_pendulum", {}), t_end, 1e-3)
    t = np.linspace(0.0, t_end, n)
    Q = Rotation.from_rotvec(np.outer(np.pi * t, [0.0, 0.0, 1.0]))
    R = Q * Rotation.from_quat(np.tile(still["frame_q"][0, 0], (n, 1)))
    poses = {
        "frame_t": t,
        "frame_r": Q.apply(np.tile(still["frame_r"][0, 0], (n, 1)))[:, None],
        "frame_q": R.as_quat()[:, None],
    }
    return dataclasses.replace(still, arrays={**still.arrays, **poses})


def test_the_body_is_where_its_pose_says():
    """At 0.5 s it has turned by a quarter: upright, seen from the front."""
    mechanism = mechanism_of(turning())
    view = view_of(mechanism)
    assert np.allclose(view, [[1, 0, 0], [0, 1, 0]], atol=1e-6)
    ends = flat(mechanism.segments(mechanism.frame(0.5)), view)[0]
    assert np.allclose(ends[1] - ends[0], [0.0, 1.0], atol=1e-6)


def test_spatial_motion_is_seen_at_an_angle():
    """Right and up stay square and of unit length, whatever the view."""
    m = mechanism_of(series_for(registry.make_problem("torque_free_body", {}), 1.0, 0.0))
    view = view_of(m)
    assert np.allclose(view @ view.T, np.eye(2), atol=1e-12)
    assert np.abs(view).max() < 0.999
