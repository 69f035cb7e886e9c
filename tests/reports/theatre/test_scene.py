"""Scenes follow from the series: peaks, moments, shapes, the plane of motion; sizes are shared fairly."""

import numpy as np
import pytest

from mbsbench.reports.mechanism.theatre.poses import Poses
from mbsbench.reports.mechanism.theatre.scene import collect_players, make_scene
from mbsbench.reports.mechanism.theatre.shapes import STRIPS, list_marks, make_shapes, make_strips, reduce_to_spans
from mbsbench.reports.model.results import StoredRun
from mbsbench.reports.pages.runs.theatre import find_size_limit
from mbsbench.tests.comparing import assert_close, assert_each
from mbsbench.tests.factories import make_measured_record

from ..conftest import HOSTILE
from .conftest import held, two_bars


@pytest.mark.parametrize("n", [1, 7, 5000])
def test_strips_keep_every_extreme(n):
    """The least and largest of all spans are those of the series, in their span of time."""
    random = np.random.default_rng(n)
    t = np.sort(random.uniform(0.0, 2.0, n))
    a = random.normal(size=n) * 10.0 ** random.integers(-12, 3, n)
    a[random.uniform(size=n) < 0.2] = np.nan
    a[0] = 1.0
    low, high = reduce_to_spans(t, a, 2.0, 50)
    assert np.nanmin(low) == np.nanmin(a) and np.nanmax(high) == np.nanmax(a)
    assert np.nanargmax(high) == min(int(t[np.nanargmax(a)] / 2.0 * 50), 49)
    assert_each(low[np.isfinite(low)], "<=", high[np.isfinite(high)])


def test_the_step_cut_to_end_at_t_end_is_no_small_step():
    """Of a run that stopped it is the point, and stays."""
    series = two_bars(50)
    series.arrays["dt"][-1] = 1e-9
    whole = make_strips(series, StoredRun(make_measured_record("x")), 2.0)
    stopped = make_strips(series, StoredRun(make_measured_record("x", "a", "diverged")), 2.0)
    row = sum(2 if s["both"] else 1 for s in STRIPS[:-1])
    assert np.nanmin(whole[row]) > 1e-3 and np.nanmin(stopped[row]) == 1e-9


def test_moments_are_the_stop_the_events_and_the_whip():
    events = [{"kind": "singular passage", "t": 0.5, "value": 0.125}, {"kind": "x"}, {"kind": "y", "t": float("nan")}]
    series = two_bars(events=events)
    found = list_marks(series, StoredRun(make_measured_record("x", "a", "diverged", message="lost")), 3)
    assert [(m["kind"], m["t"]) for m in found] == [("event", 0.5), ("whip", series["t"][100]), ("stop", 2.0)]
    assert found[0]["words"] == "singular passage, value 0.125" and "lost" in found[2]["words"]
    assert {m["player"] for m in found} == {3}
    assert "-0.02 J" in found[1]["words"]  # with its sign


def kinds(series) -> list[str]:
    poses = Poses(series["frame_t"], series["frame_r"], series["frame_q"])
    return [s.kind for s in make_shapes(series, poses, 1.0)]


def test_shapes_follow_from_joints_and_turning():
    """Bars between joints, a rod on one joint, a top if it spins about that line, three rods if held at its centre."""
    assert kinds(two_bars()) == ["rod", "ball", "ball", "rod"]  # the second bar hangs on one joint
    assert kinds(held(0.5, (-0.5, 0.0, 0.0))) == ["rod"]
    assert "disc" in kinds(held(20.0, (0.0, 0.0, -0.1))) and "cone" in kinds(held(20.0, (0.0, 0.0, -0.1)))
    assert kinds(held(1.0, (0.0, 0.0, 0.0))).count("rod") == 3


def test_a_bar_reaches_from_joint_to_joint():
    series = two_bars()
    rod = make_shapes(series, Poses(series["frame_t"], series["frame_r"], series["frame_q"]), 1.0)[0]
    assert sorted([rod.a, rod.b]) == [(-0.5, 0.0, 0.0), (0.5, 0.0, 0.0)]


def test_a_scene_holds_the_plane_the_farthest_end_and_the_sound_motions(staged):
    """A player that flies apart must not make the others a dot."""
    results, _ = staged
    variant = next(p for p in results.variants if p.problem == "pendulum")
    cast, _, left_out = collect_players(results, variant)
    play, _ = make_scene(variant, cast, {c.record.solver: _Look for c in variant.runs})
    assert_close(np.abs(play["normal"]), [0.0, 0.0, 1.0], atol=1e-6)
    assert play["trail"] == {"body": 1, "at": [0.5, 0.0, 0.0]}
    assert_each(np.abs(play["low"]), "<", 3.0)
    assert_each(np.abs(play["high"]), "<", 3.0)
    assert [c.record.solver for c in left_out] == ["epsilon"]
    assert {p["status"] for p in play["players"]} == {"success", "diverged", "wrong"}
    assert [p["rank"] for p in play["players"]] == [0, 0, 0, 0]


class _Look:
    colour = "#123456"


@pytest.mark.parametrize("whole", [1, 50, 200, 10**9])
def test_the_largest_are_cut_so_that_all_fit(whole):
    sizes = [3, 100, 20, 55, 20]
    level = find_size_limit(sizes, whole)
    cut = sum(min(s, level) for s in sizes)
    assert cut <= whole * (1 + 1e-12)
    assert cut == pytest.approx(min(sum(sizes), whole))


def test_pages_are_written_for_motions_alone_and_escaped(staged):
    """Names, labels, messages and events of a result file may hold anything."""
    _, report = staged
    pages = sorted(p.name for p in report.glob("theatre-*.html"))
    assert len(pages) == 2 and not any("lonely" in p for p in pages)
    assert not any("</script" in p.read_text(encoding="utf-8") for p in report.glob("data/*.js"))
    both = [(report / p).read_text(encoding="utf-8") for p in pages]
    assert any("&lt;script&gt;alert" in text for text in both) and HOSTILE not in "".join(both)
