"""A run with poses made by hand: two bars on hinges, a top, a body held at its centre, one that flies apart."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.results.series import Series
from mbsbench.reports.model.results import StoredResults, read_results
from mbsbench.reports.pages.base import FOLDER, Site
from mbsbench.reports.pages.runs import theatre as page
from mbsbench.tests.factories import make_measured_record, make_series

from ..conftest import HOSTILE, because, put, write_modules

ALONG_X = np.array([0.5, 0.0, 0.0])
JOINTS = {"joint_i": [0, 0], "joint_j": [-1, 1], "joint_s_i": [-ALONG_X, ALONG_X], "joint_s_j": [0 * ALONG_X, -ALONG_X]}


def about_z(angle: np.ndarray) -> np.ndarray:
    """Quaternions (x, y, z, w) of turns about OZ."""
    zero = np.zeros_like(angle)
    return np.stack((zero, zero, np.sin(angle / 2), np.cos(angle / 2)), axis=-1)


def two_bars(n=400, t_end=2.0, *, stretch=1.0, size=1e-3, events=(), bar="bar", exact=False) -> Series:
    """A double pendulum in OXY at angles of our own; the energy error has one sharp peak at a quarter of the time."""
    t = np.linspace(0.0, t_end, n)
    angle = np.stack((-1.0 + np.sin(4.0 * t), -1.5 + np.sin(5.0 * t)), axis=-1)
    error = size * np.sin(3.0 * t)
    error[n // 4] = -20.0 * size
    out = make_posed_series(
        t, *bars(angle, stretch), JOINTS, error, (0.0, -9.81, 0.0), events, (f"{bar} 1", f"{bar} 2")
    )
    if exact:  # it swings apart from the run, known for three quarters of the time
        k = 3 * n // 4
        other = make_posed_series(t, *bars(angle - 0.3 * t[:, None]), JOINTS, error)
        out.arrays.update({f"exact_{name}": other[f"frame_{name}"][:k] for name in ("t", "r", "q")})
    return out


def bars(angle: np.ndarray, stretch: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Positions and quaternions of two bars at ``angle`` from OX, the second on the end of the first."""
    along = stretch * np.stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)), axis=-1)
    return np.stack((0.5 * along[:, 0], along[:, 0] + 0.5 * along[:, 1]), axis=1), about_z(angle)


def make_posed_series(t, r, q, joints, error, gravity=(0.0, 0.0, -9.81), events=(), names=("body",)) -> Series:
    """A series file with poses."""
    return make_series(
        t,
        energy_error=error,
        phi_norm=np.abs(error) + 1e-12,
        phi_dot_norm=np.abs(error),
        frame_t=t,
        frame_r=r.astype(np.float32),
        frame_q=q.astype(np.float32),
        gravity=gravity,
        end_r=r[-1],
        **{k: np.array(v) for k, v in joints.items()},
        events=events,
        bodies=names,
        joints=["A"],
    )


def held(spin: float, offset, n: int = 200, t_end: float = 2.0) -> Series:
    """A body on one joint ``offset`` from its centre, turning about OZ."""
    t = np.linspace(0.0, t_end, n)
    q = about_z(spin * t)[:, None]
    c, s = np.cos(spin * t), np.sin(spin * t)
    x, y, z = -np.asarray(offset, dtype=float)
    r = np.stack((c * x - s * y, s * x + c * y, np.full(n, z)), axis=-1)[:, None]
    joints = {"joint_i": [0], "joint_j": [-1], "joint_s_i": [offset], "joint_s_j": [(0.0, 0.0, 0.0)]}
    return make_posed_series(t, r, q, joints, np.full(n, 1e-9))


@pytest.fixture(scope="session")
def staged(tmp_path_factory):
    """The run and the folder of its theatres."""
    folder = tmp_path_factory.mktemp("theatre")
    event = {"kind": "singular passage", "t": 0.5, "smallest_singular_value": 1e-4, "note": HOSTILE}
    put(folder, make_measured_record("a1"), two_bars(exact=True))
    put(folder, make_measured_record("a2", "beta", dt_s=0.02), two_bars(size=0.1, events=[event, {"kind": "no time"}]))
    put(
        folder,
        make_measured_record("a3", "gamma", "diverged", label="as printed", message=f"lost {HOSTILE}", t_reached_s=0.8),
        two_bars(160, 0.8, size=0.3),
    )
    put(
        folder,
        make_measured_record("a4", "delta", "wrong", label=HOSTILE, wrong_because=because(HOSTILE)),
        two_bars(stretch=1e6, bar=HOSTILE),
    )
    put(folder, make_measured_record("a5", "epsilon", "refused", message="not for two bars"))
    put(folder, make_measured_record("b1", HOSTILE, problem=HOSTILE), held(20.0, (0.0, 0.0, -0.1)))
    put(folder, make_measured_record("c1", problem="lonely", status="refused"))
    results = read_results(folder)
    return results, staged_pages(results)


def staged_pages(results: StoredResults) -> Path:
    """The folder of the theatres of these results."""
    folder = results.folder / "report"
    site = Site(results, ConfinedPath(folder))
    shutil.copytree(FOLDER / "assets", folder / "assets")
    (folder / "data").mkdir()
    write_modules(site, [page])
    site.finish()
    return folder
