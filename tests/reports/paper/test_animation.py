"""Animations: as many pictures as asked for, at their times, and clear words for what cannot be shown."""

import dataclasses

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from mbsbench.harness.catalogue import registry
from mbsbench.harness.suites.spec import make_spec
from mbsbench.reports.mechanism.animation import animate, choose, files, runs_of
from mbsbench.reports.mechanism.animation.stage import Stage, actors_of, flat, view_of
from mbsbench.reports.mechanism.paths import PointPath
from mbsbench.reports.mechanism.segments import mechanism_of
from mbsbench.reports.plots.style import INK

from ..conftest import put
from .conftest import record_for, series_for

PENDULUM = registry.make_problem("spherical_pendulum", {})
GC, COARSE = (make_spec(PENDULUM, "gc_weak_form", control={"dt": dt}) for dt in (0.01, 0.02))
RK = make_spec(PENDULUM, "rk45_strong_form", control={"rtol": 1e-8})


def turning(t_end: float = 2.0, n: int = 81):
    """A pendulum that turns once about OZ in two seconds, as a series file."""
    still = series_for(PENDULUM, t_end, 1e-3)
    t = np.linspace(0.0, t_end, n)
    angle = np.pi * t
    arm = still["frame_r"][0, 0]
    c, s, zero = np.cos(angle), np.sin(angle), np.zeros(n)
    Q = np.array([[c, -s, zero], [s, c, zero], [zero, zero, 1.0 + zero]]).transpose(2, 0, 1)
    from scipy.spatial.transform import Rotation

    R = Q @ Rotation.from_quat(still["frame_q"][0, 0]).as_matrix()
    poses = {"frame_t": t, "frame_r": (Q @ arm)[:, None], "frame_q": Rotation.from_matrix(R).as_quat()[:, None]}
    return dataclasses.replace(still, arrays={**still.arrays, **poses})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("run")
    put(path, record_for(GC, run_id="a" * 16, t_end_s=2.0, t_reached_s=2.0), turning())
    put(path, record_for(RK, run_id="b" * 16, t_end_s=2.0, t_reached_s=1.0, status="singular"), turning(1.0))
    put(path, record_for(COARSE, run_id="c" * 16, status="refused"), None)
    return path


def test_gif_has_the_pictures_asked_for(folder, tmp_path):
    """Their number, their pace, and a body that moves in them."""
    out = tmp_path / "p.gif"
    said = animate(folder, "spherical_pendulum", ["gc_weak_form"], out, frames=12, fps=20)
    assert "12 pictures, 0 to 2 s" in said
    with Image.open(out) as picture:
        assert picture.n_frames == 12 and picture.info["duration"] == 50
        first = np.asarray(picture.convert("RGB")).astype(int)
        picture.seek(3)
        later = np.asarray(picture.convert("RGB")).astype(int)
    assert (first[0, 0] == 255).all()
    assert np.count_nonzero(np.abs(first - later).sum(axis=2) > 60) > 500
    assert out.stat().st_size < 1_000_000


def test_the_body_is_where_its_pose_says(folder):
    """At 0.5 s it has turned by a quarter: upright, seen from the front."""
    (actor,) = actors_of(folder, choose(runs_of(folder), "spherical_pendulum", ["gc_weak_form"]))
    stage = Stage([actor], ghosts=False, frames=3, window=(0.0, 1.0))
    pictures = list(stage.pictures())
    assert len(pictures) == 3 and stage.t.tolist() == [0.0, 0.5, 1.0]
    assert np.allclose(view_of(actor.mechanism), [[1, 0, 0], [0, 1, 0]], atol=1e-6)
    k = actor.mechanism.frame(0.5)
    ends = flat(actor.mechanism.segments(k), stage.view)[0]
    assert np.allclose(ends[1] - ends[0], [0.0, 1.0], atol=1e-6)


def test_the_point_is_traced_in_colour_and_its_exact_path_in_ink_to_the_horizon(folder):
    """Two lines where nothing else is: the run's below, the exact one above, which is known for half of the time."""
    (actor,) = actors_of(folder, choose(runs_of(folder), "spherical_pendulum", ["gc_weak_form"]))
    t = np.linspace(0.0, 1.0, 50)
    own, exact = (np.stack([-0.8 + 0.6 * t, 0.0 * t + y, 0.0 * t], axis=1) for y in (-0.2, 0.2))
    path = PointPath("E", t, own, t[:25], exact[:25])
    stage = Stage([dataclasses.replace(actor, path=path)], ghosts=False, frames=3, window=(0.0, 1.0))
    _, half, whole = (p.astype(int) for p in stage.pictures())
    ax = stage.trails[0][0]

    def nearest(picture, place, colour: str) -> float:
        """Of the pixels around a place to a colour, 0 to 255."""
        x, y = np.rint(ax.transData.transform(flat(place[None], stage.view)[0])).astype(int)
        around = picture[len(picture) - y - 3 : len(picture) - y + 3, x - 2 : x + 3].reshape(-1, 3)
        return np.abs(around - 255.0 * np.array(to_rgb(colour))).max(axis=1).min()

    assert nearest(half, own[23], actor.look.colour) < 60 and nearest(whole, own[48], actor.look.colour) < 60
    assert nearest(half, exact[23], INK) < 60
    assert nearest(whole, exact[48], INK) > 150  # beyond the horizon


def test_spatial_motion_is_seen_at_an_angle():
    """Right and up stay square and of unit length, whatever the view."""
    m = mechanism_of(series_for(registry.make_problem("torque_free_body", {}), 1.0, 0.0))
    view = view_of(m)
    assert np.allclose(view @ view.T, np.eye(2), atol=1e-12)
    assert np.abs(view).max() < 0.999


def test_side_by_side_and_as_ghosts(folder):
    """A panel each, or one for all; the one that stopped turns grey after its end."""
    actors = actors_of(folder, choose(runs_of(folder), "spherical_pendulum", []))
    assert [a.run.record.solver for a in actors] == ["gc_weak_form", "rk45_strong_form"]
    assert len(Stage(actors, ghosts=False, frames=2).figure.axes) == 3
    ghosts = Stage(actors, ghosts=True, frames=4)
    assert len(ghosts.figure.axes) == 2
    assert "singular at 1 s" in ghosts.figure.legends[0].get_texts()[1].get_text()
    colours = []
    for _ in ghosts.pictures():
        colours.append(tuple(ghosts.bodies[1][1].get_color()[0]))
    assert colours[0] == colours[1] != colours[-1]


def test_mp4_without_ffmpeg_says_what_to_do(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(files, "ffmpeg", lambda: None)
    with pytest.raises(ValueError, match=r"needs ffmpeg: install it, or `pip install imageio-ffmpeg`"):
        animate(folder, "spherical_pendulum", [], tmp_path / "x.mp4")


@pytest.mark.skipif(files.ffmpeg() is None, reason="no ffmpeg on this machine")
def test_mp4_is_written(folder, tmp_path):
    animate(folder, "spherical_pendulum", ["gc_weak_form"], tmp_path / "x.mp4", frames=5)
    assert b"ftyp" in (tmp_path / "x.mp4").read_bytes()[:16]
