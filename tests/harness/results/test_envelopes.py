"""An envelope holds every value of its spans, and a file gives back what was packed into it."""

import dataclasses

import numpy as np
import pytest

from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.results.envelopes import SPANS, compute_envelope, find_spans
from mbsbench.harness.results.packing import GRID, TURNS
from mbsbench.harness.results.series import EnvelopedSeries, Series, read_series, write_series
from mbsbench.tests.comparing import assert_each, assert_same

COARSE = 2.0**-10  # of a value, the error of its code
KINDS = ("all sizes", "a swing", "rounding", "zeros of both signs", "with holes", "nearly constant", "constant", "none")


def some_values(kind, n):
    random = np.random.default_rng(3)
    if kind == "all sizes":
        return random.normal(size=n) * 10.0 ** random.uniform(-320, 300, n)
    found = {
        "a swing": np.sin(np.linspace(0.0, 40.0, n)),
        "rounding": 1e-16 * random.integers(-3, 4, n),
        "zeros of both signs": np.where(random.random(n) < 0.5, 0.0, -0.0),
        "with holes": random.normal(size=n),
        "nearly constant": -0.3 + 1e-14 * random.normal(size=n),
        "constant": np.full(n, 1.0 / 3.0),
        "none": np.full(n, np.nan),
    }[kind]
    if kind == "with holes":
        found[::7], found[::31] = np.nan, np.inf
    return found


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [2, 500, 9000])
def test_an_envelope_contains_every_finite_value(kind, n):
    """Codes are rounded outwards, so no value is outside, whatever its size; nor is the envelope much wider."""
    t = np.sort(np.random.default_rng(n).uniform(0.0, 20.0, n))
    a = some_values(kind, n)
    e = compute_envelope(t, a)
    good = np.isfinite(a)
    span = find_spans(t[good], e.begin, e.end, SPANS)
    assert_each(e.low[span], "<=", a[good])
    assert_each(a[good], "<=", e.high[span])
    for k in np.unique(span):
        own = a[good][span == k]
        tiny = np.finfo(np.float32).tiny
        if np.abs(own).max() < np.finfo(np.float32).max / 2:
            assert e.low[k] >= own.min() - COARSE * abs(own.min() - e.base) - tiny
            assert e.high[k] <= own.max() + COARSE * abs(own.max() - e.base) + tiny
    empty = np.setdiff1d(np.arange(SPANS), span)
    np.testing.assert_array_equal(e.low[empty], np.nan)
    np.testing.assert_array_equal(e.high[empty], np.nan)


@pytest.mark.parametrize("spans", [240, 180, 80, 60])
def test_points_lie_in_the_spans_of_curves(spans):
    """A curve of fewer spans takes the points of an envelope to the spans that the rows were in."""
    e = compute_envelope(np.array([0.0, 7.3]), np.zeros(2))
    t, _ = e.points
    drawn = np.minimum((t[::2] / t[-1] * spans).astype(int), spans - 1)
    assert_same(drawn, np.arange(SPANS) * spans // SPANS)


def brief(n=1000, nb=2):
    random = np.random.default_rng(5)
    dt = random.uniform(0.5, 1.5, n - 1)
    t = np.concatenate(([0.0], np.cumsum(dt)))
    q = random.normal(size=(40, nb, 4))
    arrays = {
        "t": t,
        "dt": np.insert(np.diff(t), 0, np.nan),
        "energy": random.normal(size=n),
        "frame_t": t[7:287:7],
        "frame_r": random.uniform(-3.0, 3.0, (40, nb, 3)).astype(np.float32),
        "frame_q": (q / np.linalg.norm(q, axis=2, keepdims=True)).astype(np.float32),
    }
    kept = {name: compute_envelope(t, random.normal(size=n)) for name in ("phi_norm", "obs_y")}
    kept["obs_x"] = compute_envelope(t, 7.0 + random.random(n))
    return Series(arrays, (), ("a", "b"), (), {}, {}, {"phi_max": 1.0}, "own", kept, "5" * 64, 2.0)


def test_a_brief_file_gives_back_what_is_judged_to_the_bit_and_what_is_drawn_to_the_grid(tmp_path):
    """Times are sums of steps, which is checked before they are left out; quaternions of both signs are one turn."""
    series = brief()
    digest = write_series(ConfinedPath(tmp_path) / "s.npz.xz", series)
    again = read_series(tmp_path / "s.npz.xz", digest)
    for name in ("t", "dt", "energy", "frame_t"):
        assert again[name].tobytes() == series[name].tobytes()
    assert np.abs(again["frame_r"] - series["frame_r"]).max() < 0.51 * GRID * series.length
    cosine = np.abs(np.sum(again["frame_q"].astype(float) * series["frame_q"], axis=2))
    assert_each(cosine, ">", 1.0 - (2.0 / TURNS) ** 2)
    assert again.envelopes.keys() == series.envelopes.keys()
    for name, e in series.envelopes.items():
        found = again.envelopes[name]
        assert_same(found.codes, e.codes)
        assert (found.end, found.base) == (e.end, e.base)
    assert (again.steps_sha256, again.length, again.peaks) == (series.steps_sha256, 2.0, series.peaks)
    without = read_series(tmp_path / "s.npz.xz", poses=False)
    assert "frame_r" not in without and "frame_q" not in without and "phi_norm" in without


def test_times_that_are_no_sums_of_steps_are_kept(tmp_path):
    """A growing first step may round; rows of a thinned series have steps between them."""
    series = brief()
    t = series["t"].copy()
    t[500:] = np.nextafter(t[500:], np.inf)
    write_series(tmp_path / "s.npz.xz", dataclasses.replace(series, arrays={**series.arrays, "t": t}))
    assert read_series(tmp_path / "s.npz.xz")["t"].tobytes() == t.tobytes()


def test_a_motion_that_flew_away_keeps_its_positions(tmp_path):
    """The grid of a motion of 2 m does not reach 1e30 m."""
    series = brief()
    far = series["frame_r"] * np.float32(1e30)
    write_series(tmp_path / "s.npz.xz", dataclasses.replace(series, arrays={**series.arrays, "frame_r": far}))
    assert_same(read_series(tmp_path / "s.npz.xz")["frame_r"], far)


def test_rows_of_an_envelope_are_refused():
    """No rough value passes for one of a step: who asks for rows is told."""
    series = brief()
    for ask in (lambda: series["phi_norm"], lambda: series.get("phi_norm")):
        with pytest.raises(EnvelopedSeries, match="phi_norm is stored as an envelope"):
            ask()
    assert series.get("nothing") is None and "phi_norm" in series
    assert len(series.points("phi_norm")[0]) == 2 * SPANS and len(series.points("energy")[0]) == 1000


@pytest.mark.parametrize("fault", ["cut short", "not packed", "wrong shape"])
def test_a_damaged_brief_file_is_refused_in_one_line(tmp_path, fault):
    """A results folder may come from anybody."""
    path = tmp_path / "s.npz.xz"
    write_series(path, brief())
    if fault == "cut short":
        path.write_bytes(path.read_bytes()[:-40])
    else:
        import lzma
        import zipfile

        content = lzma.decompress(path.read_bytes())
        (tmp_path / "plain.npz").write_bytes(content)
        with zipfile.ZipFile(tmp_path / "plain.npz") as source:
            members = {n: source.read(n) for n in source.namelist()}
        if fault == "not packed":
            members["env_obs_x.npy"] = members["energy.npy"]
        else:
            members["packed_frame_shape.npy"] = members["env.npy"]
        with lzma.open(path, "wb") as file, zipfile.ZipFile(file, "w") as target:
            for name, data in members.items():
                target.writestr(name, data)
    with pytest.raises(ValueError, match="not a whole series file"):
        read_series(path)
