"""Plots: solvers keep their looks, peaks survive, groups stay small, numbers in data files are the numbers measured."""

import dataclasses
import itertools
import json

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from mbsbench.reports.model import curves
from mbsbench.reports.model.motion import read_curves
from mbsbench.reports.model.results import StoredRun, read_results
from mbsbench.reports.pages.judged.cost import measure_growths
from mbsbench.reports.plots import paper, spec
from mbsbench.reports.plots.browser import (
    LOG_STEP,
    STEPS,
    Steps,
    format_bundle,
    format_json,
    format_script,
    shorten_plots,
)
from mbsbench.reports.plots.laws import (
    Drawing,
    make_limit_line,
    plot_errors,
    plot_invariants,
    plot_laws,
    plot_observables,
)
from mbsbench.reports.plots.lines import MOST, choose_lines, make_traces
from mbsbench.reports.plots.paper import Legend, draw_plots
from mbsbench.reports.plots.spec import Axis, Plot, Trace
from mbsbench.reports.plots.work import make_work_chapter
from mbsbench.tests.comparing import assert_each
from mbsbench.tests.factories import make_measured_record, make_swing

from .conftest import HOSTILE, put
from .outline import opened

CATALOGUE = ("gc_weak_form", "gc_augmented_lagrangian", "rk45_strong_form", "ndf_index1", "ida_index1", "ida_index3")


def url(run) -> str:
    return run.record.run_id


def drawing_of(folder) -> Drawing:
    results = read_results(folder)
    variant = next(p for p in results.variants if p.problem == "pendulum")
    lines = choose_lines(variant, url)
    return Drawing(variant.runs, lines, {k.run.record.run_id: read_curves(k.run, results.series(k.run)) for k in lines})


SEEN_WITH = {  # linear RGB as seen by a dichromat: Machado, Oliveira, Fernandes (2009)
    "all cones": np.eye(3),
    "protanopia": np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                            [-0.003882, -0.048116, 1.051998]]),
    "deuteranopia": np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                              [-0.011820, 0.042940, 0.968881]]),
    "tritanopia": np.array([[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                            [0.004733, 0.691367, 0.303900]]),
}  # fmt: skip
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)


def linear(colour: str) -> np.ndarray:
    c = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    x = XYZ @ np.clip(rgb, 0.0, 1.0) / XYZ.sum(axis=1)
    f = np.where(x > 0.008856, np.cbrt(x), 7.787 * x + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


def apart(one: np.ndarray, two: np.ndarray) -> float:
    """CIEDE2000 (Sharma, Wu, Dalal 2005)."""
    (L1, a1, b1), (L2, a2, b2) = one, two
    mean = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2.0
    g = 1.5 - 0.5 * np.sqrt(mean**7 / (mean**7 + 25.0**7))
    c1, c2 = np.hypot(g * a1, b1), np.hypot(g * a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, g * a)) % 360.0 for a, b in ((a1, b1), (a2, b2)))
    dh = (h2 - h1 + 180.0) % 360.0 - 180.0
    hue, L, c = np.radians((h1 + dh / 2.0) % 360.0), (L1 + L2) / 2.0, (c1 + c2) / 2.0
    t = 1.0 - 0.17 * np.cos(hue - np.pi / 6) + 0.24 * np.cos(2 * hue) + 0.32 * np.cos(3 * hue + np.radians(6.0))
    t -= 0.20 * np.cos(4 * hue - np.radians(63.0))
    light = (L2 - L1) / (1.0 + 0.015 * (L - 50.0) ** 2 / np.sqrt(20.0 + (L - 50.0) ** 2))
    chroma, turn = (
        (c2 - c1) / (1.0 + 0.045 * c),
        2.0 * np.sqrt(c1 * c2) * np.sin(np.radians(dh / 2.0)) / (1.0 + 0.015 * c * t),
    )
    bend = np.sin(2.0 * np.radians(30.0 * np.exp(-(((np.degrees(hue) - 275.0) / 25.0) ** 2))))
    rotate = -2.0 * np.sqrt(c**7 / (c**7 + 25.0**7)) * bend
    return float(np.sqrt(light**2 + chroma**2 + turn**2 + rotate * chroma * turn))


def test_the_measure_of_colours_is_that_of_its_authors():
    """The first and the seventh pair of their table: 2.0425 and 0.0000 with equal colours."""
    one, two = np.array([50.0, 2.6772, -79.7751]), np.array([50.0, 0.0, -82.7485])
    assert apart(one, two) == pytest.approx(2.0425, abs=1e-4) and apart(one, one) == 0.0


@pytest.mark.parametrize("sight", SEEN_WITH)
def test_families_are_told_apart_with_any_sight(sight):
    """At least 15 apart, and at a contrast of 2.5 on white and 2.9 on dark pages."""
    colours = {f: c for f, (c, _) in spec.FAMILIES.items()} | spec.OTHERS
    seen = {f: lab(SEEN_WITH[sight] @ linear(c)) for f, c in colours.items()}
    for (f, one), (g, two) in itertools.combinations(seen.items(), 2):
        assert apart(one, two) > 15.0, (f, g)
    for colour in colours.values():
        light = XYZ[1] @ linear(colour) + 0.05
        assert 1.05 / light > 2.5 and light / (XYZ[1] @ linear("#1b1f23") + 0.05) > 2.9


def test_looks_follow_from_the_name_whoever_takes_part():
    """A colour is a family, a marker a solver of it; every shipped solver has a family."""
    shipped = spec.list_catalogue_styles()
    together = spec.choose_styles(CATALOGUE)
    assert all(spec.choose_styles([name])[name] == together[name] == shipped[name] for name in CATALOGUE)
    assert spec.PLUGINS not in {look.family for look in shipped.values()}
    own = spec.choose_styles(["aaa", *shipped, "zzz"])
    assert {name for name, look in own.items() if look.family == spec.PLUGINS} == {"aaa", "zzz"}
    assert sum(map(len, spec.group_by_family(own).values())) == len(own)
    assert len(spec.choose_styles(f"solver{k}" for k in range(20))) == 20  # more than there are colours


def test_in_print_no_two_solvers_have_one_marker():
    """Grey prints have no colour: as many solvers as there are markers, engines too; each keeps its own if free."""
    names = ["gc_weak_form", "rattle", "rkmk_dopri5", "ida_index1", "mujoco", "exudyn", "mine"]
    found, usual = spec.choose_print_styles(names), spec.choose_styles(names)
    assert len({look.marker for look in usual.values()}) < len(names)
    assert len({look.marker for look in found.values()}) == len(names)
    assert all(found[n].colour == usual[n].colour and found[n].family == usual[n].family for n in names)
    assert found["exudyn"] == usual["exudyn"]
    many = spec.choose_print_styles(f"solver{k}" for k in range(len(spec.IN_PRINT)))
    assert {look.marker for look in many.values()} == set(spec.IN_PRINT)
    assert not {"*", "X"} & set(spec.IN_PRINT)  # which mark how runs end
    x = np.array([1.0, 2.0])
    traces = [Trace(name, x, x, solver=name, mode="lines+markers") for name in names]
    markers = [str(h.get_marker()) for h in Legend.build(traces, found, wide=True).handles]
    assert len(set(markers)) == len(names)


@pytest.mark.beyond_core
def test_engines_have_a_marker_of_their_own():
    """Whether it is installed or not: what is not ours is seen at a glance, in pictures for papers too."""
    looks = spec.choose_styles([*CATALOGUE, "mine", "mujoco", "exudyn"])
    assert {name for name, look in looks.items() if look.marker == spec.ENGINE} == {"mujoco", "exudyn"}
    x = np.array([1.0, 2.0])
    traces = [Trace(name, x, x, solver=name, mode="lines+markers") for name in ("mujoco", "gc_weak_form")]
    handles = Legend.build(traces, looks, wide=True).handles
    assert [h.get_label() for h in handles] == ["gc_weak_form", "mujoco (engine)"]
    assert [h.get_marker() == spec.ENGINE for h in handles] == [False, True]


def test_the_reference_is_drawn_to_its_horizon(tmp_path):
    """A run that stopped early has as many points in a part of the time: it is not where the reference ends."""
    put(tmp_path, make_measured_record("aa01"), make_swing(100))
    put(
        tmp_path,
        make_measured_record("aa02", "beta", "singular", t_reached_s=0.3, message="pivot"),
        make_swing(2000, 0.3),
    )
    drawn = drawing_of(tmp_path)
    (theta, *_) = [p for p in plot_observables(drawn).plots if p.name == "obs-theta"]
    (exact,) = [t for t in theta.traces if t.name == "reference"]
    assert exact.x[-1] == pytest.approx(2.0)
    (position, *_) = plot_errors(drawn).plots
    (own,) = [t for t in position.traces if not t.solver]
    assert own.x[-1] == pytest.approx(2.0)


def test_a_law_has_the_line_of_its_limit(tmp_path):
    """Beyond it a run is wrong: it is seen however small the errors are. Constraints have one where it was recorded."""
    put(tmp_path, make_measured_record("aa01", phi_limit_m=0.01, phi_dot_limit_m_per_s=0.1), make_swing(size=1e-9))
    energy, phi, phi_dot, *_ = plot_laws(drawing_of(tmp_path)).plots
    (line,) = [t for t in energy.traces if not t.solver]
    assert line.y == pytest.approx(0.1 * np.ones(2)) and line.name == "limit 0.100 J"  # a tenth of energy_scale_J
    assert energy.y.low < line.y[0] < energy.y.high
    assert [p.traces[-1].y[0] for p in (phi, phi_dot)] == pytest.approx([0.01, 0.1])
    put(tmp_path, make_measured_record("aa01", finished="later"), make_swing(size=1e-9))
    assert [all(t.solver for t in p.traces) for p in plot_laws(drawing_of(tmp_path)).plots[:3]] == [False, True, True]


def test_each_run_has_its_own_limit():
    """One line where they agree within 1 %, else the least, which says so; who stopped was not judged."""
    stopped = StoredRun(make_measured_record("zz01", status="stalled", energy_scale_J=1e-6))

    def name(*sizes: float) -> str:
        runs = [StoredRun(make_measured_record(f"a{k}", energy_scale_J=size)) for k, size in enumerate(sizes)]
        return make_limit_line([*runs, stopped], "energy_drift_max_J", 2.0)[0].name

    assert name(1.0, 1.005) == "limit 0.100 J"
    assert name(9.0, 1.0) == "least limit 0.100 J, each run its own"
    assert make_limit_line([stopped], "energy_drift_max_J", 2.0) == []


def test_finest_settings_are_solid_and_stand_for_their_solver(tmp_path):
    put(tmp_path, make_measured_record("aa01", dt_s=0.01))
    put(tmp_path, make_measured_record("aa02", dt_s=0.005))
    by_run = {k.run.record.run_id: k for k in choose_lines(read_results(tmp_path).variants[0], url)}
    assert (by_run["aa02"].main, by_run["aa02"].dash) == (True, 0)
    assert (by_run["aa01"].main, by_run["aa01"].dash) == (False, 1)


def test_a_curve_that_lies_on_another_is_dashed_and_says_so(tmp_path):
    """Two solvers with one motion would look like one; a third that is a tenth of a decade off has its own line."""
    for run, solver, size in (("aa01", "alpha", 1e-3), ("bb01", "beta", 1.0001e-3), ("cc01", "gamma", 2e-3)):
        put(tmp_path, make_measured_record(run, solver), make_swing(size=size))
    energy = plot_laws(drawing_of(tmp_path)).plots[0]
    found = {t.solver: t for t in energy.traces}
    assert found["beta"].dash == 1 and found["beta"].name.endswith("coincides with alpha")
    assert all(found[s].dash == 0 and "coincides" not in found[s].name for s in ("alpha", "gamma"))


def test_of_a_large_group_the_finest_and_the_failures_are_drawn(tmp_path):
    """A map of a hundred runs must not bury its failures, nor fill the disk."""
    for k in range(60):
        bad = k in (7, 21)
        put(
            tmp_path,
            make_measured_record(f"c{k:02}", dt_s=0.001 * (k + 1), label="map", status="wrong" if bad else "success"),
        )
    drawn = {k.run.record.run_id for k in choose_lines(read_results(tmp_path).variants[0], url)}
    assert len(drawn) == MOST and {"c00", "c07", "c21"} <= drawn


def test_ends_are_marked_and_settings_named(built):
    d = drawing_of(built[0])
    found = {t.solver: t for t in make_traces(d.match_lines("energy_error", d.lines), (0.0, 1.0))}
    assert found["delta"].end == "failed" and "step underflow at 0.7 s" in found["delta"].name
    assert found["beta"].end == "wrong" and found["delta"].urls == ("dd01",)
    assert float(found["delta"].x[-1]) == pytest.approx(0.7)


def test_a_motion_that_blew_up_does_not_hide_the_others(tmp_path):
    """The axis ends at a multiple of the problem's own scale; the curve is cut there, not dropped."""
    put(tmp_path, make_measured_record("aa01"), make_swing())
    put(tmp_path, make_measured_record("bb01", "beta", "diverged", t_reached_s=2.0), make_swing(size=1e30))
    chapter = plot_laws(drawing_of(tmp_path))
    assert chapter is not None
    energy = chapter.plots[0]
    assert energy.y.high < 1e5 and max(float(t.y.max()) for t in energy.traces) == pytest.approx(energy.y.high)


def test_every_quantity_of_a_series_has_its_plot(built):
    d = drawing_of(built[0])
    names = {
        p.name
        for make in (plot_laws, plot_errors, plot_observables, plot_invariants)
        if (c := make(d))
        for p in c.plots
    }
    assert names >= {"energy", "phi", "phi-dot", "step", "position", "orientation", "obs-theta", "away-theta", "inv-L"}


def test_work_has_points_of_every_finite_run(built):
    """Bars apart: a star for who stopped, a cross for who is wrong; each with its own link."""
    variant = next(p for p in read_results(built[0]).variants if p.problem == "pendulum")
    chapter = make_work_chapter(variant, url)
    assert chapter is not None
    points = {
        u: (e, x)
        for p in chapter.plots
        if p.name == "work-error-cpu"
        for t in p.traces
        for u, e, x in zip(t.urls, t.ends, t.x, strict=True)
    }
    assert points["dd01"][0] == "failed" and points["bb01"][0] == "wrong" and points["aa01"] == ("", 0.1)
    joined = next(t for p in chapter.plots for t in p.traces if set(t.urls) == {"aa01", "aa02"})
    assert joined.mode == "lines+markers"  # two steps of the same settings


def test_lines_are_drawn_for_runs_without_an_observable(tmp_path):
    """Two plugins' runs of one problem need not hold the same series."""
    poor = make_swing(30)
    poor = dataclasses.replace(poor, arrays={k: poor[k] for k in ("t", "energy_error")})
    put(tmp_path, make_measured_record("aa01"), make_swing(30))
    put(tmp_path, make_measured_record("bb01", "beta"), poor)
    d = drawing_of(tmp_path)
    for make in (plot_laws, plot_errors, plot_observables, plot_invariants):
        chapter = make(d)
        assert chapter is not None
        for plot in chapter.plots:
            format_bundle("x", shorten_plots([plot], {}))


def test_peaks_survive_decimation():
    """One sample out of 50,000 stands out: it must be seen."""
    t = np.linspace(0.0, 1.0, 50_000)
    a = 1e-6 * np.sin(900.0 * t)
    a[31_415] = -7.0
    assert curves.find_maxima(t, a, 1.0).y.max() == 7.0
    assert curves.find_extrema(t, a, 1.0).y.min() == -7.0
    assert len(curves.find_maxima(t, a, 1.0)) <= curves.SPANS_UPPER
    assert len(curves.find_extrema(t, a, 1.0)) <= 2 * curves.SPANS_SIGNED + 2


@pytest.mark.parametrize("kind", [curves.find_maxima, curves.find_extrema, curves.find_band])
def test_decimation_takes_anything(kind):
    """Empty, one point, all NaN, a motion that blew up."""
    for t, a in (([], []), ([0.0], [1.0]), ([0.0, 1.0], [np.nan, np.nan]), ([0.0, 1.0, 2.0], [0.0, np.inf, 1e300])):
        curve = kind(np.array(t), np.array(a), 1.0)
        assert_each(np.abs(curve.y), "<", np.inf)


def test_band_holds_median_smallest_and_largest():
    """Against the plain way, span by span; spans are unequally full."""
    rng = np.random.default_rng(0)
    t, a = np.sort(rng.uniform(0.0, 1.0, 3001)), rng.lognormal(size=3001)
    curve = curves.find_band(t, a, 1.0)
    span = np.minimum((t * curves.SPANS_UPPER).astype(int), curves.SPANS_UPPER - 1)
    expected = [(np.median(a[span == k]), a[span == k].min(), a[span == k].max()) for k in np.unique(span)]
    assert curve.low is not None and curve.high is not None
    np.testing.assert_array_equal(np.stack((curve.y, curve.low, curve.high), axis=1), expected)


def test_level_keeps_every_change():
    """A constant step is two points; a jump keeps both of its sides."""
    t = np.arange(8.0)
    assert len(curves.drop_repeated(curves.Curve(t, np.ones(8)))) == 2
    kept = curves.drop_repeated(curves.Curve(t, np.array([1.0, 1, 1, 2, 2, 2, 1, 1])))
    np.testing.assert_array_equal(np.interp(t, kept.t, kept.y), [1, 1, 1, 2, 2, 2, 1, 1])


def test_what_is_no_number_is_null_in_json():
    assert json.loads(format_json({"a": [float("nan"), float("inf"), np.float64(2.0)]})) == {"a": [None, None, 2.0]}


def test_a_bundle_gives_its_numbers_back_to_the_stated_precision():
    """Times and linear values to half a step of their range, others to a tenth of a percent, zeros as zeros."""
    rng = np.random.default_rng(0)
    t, noise = np.sort(rng.uniform(0.0, 40.0, 999)), 10.0 ** rng.uniform(-17.0, 5.0, 999)
    noise[::7] = 0.0
    swing = 3.0 * np.sin(t) - 1.0
    given = {
        "t": Steps(t),
        "y": Steps(noise, log=True),
        "swing": Steps(swing, log=True),
        "none": Steps(t[:0]),
        "zeros": Steps(np.zeros(5), log=True),
        "exact": noise,
        "counts": np.arange(70000),
        "text": HOSTILE,
        "level": Steps(np.full(4, 2.5)),
        "wild": Steps(np.array([1e-300, 1e300]), log=True),
    }
    found = opened(format_bundle("x", given))
    assert found["text"] == HOSTILE and len(found["none"]) == 0
    assert np.abs(found["t"] - t).max() <= 0.51 * np.ptp(t) / STEPS
    assert np.abs(found["swing"] - swing).max() <= 0.51 * np.ptp(swing) / STEPS  # negative: no logarithm
    np.testing.assert_allclose(found["y"], noise, rtol=0.51 * LOG_STEP)
    np.testing.assert_array_equal(found["zeros"], 0.0)
    np.testing.assert_array_equal(found["level"], 2.5)
    np.testing.assert_array_equal(found["counts"], np.arange(70000))
    np.testing.assert_allclose(found["exact"], noise, rtol=1e-7)
    np.testing.assert_allclose(found["wild"], [1e-300, 1e300], rtol=0.02)


def test_a_curve_costs_few_bytes(tmp_path):
    """A run has ten thousand of them: a noisy one of 240 spans takes less than a kilobyte, texts are told once."""
    rng = np.random.default_rng(0)
    noisy = make_swing(4000)
    noisy = dataclasses.replace(noisy, arrays={**noisy.arrays, "energy_error": rng.lognormal(size=4000)})
    put(tmp_path, make_measured_record("aa01"), noisy)
    d = drawing_of(tmp_path)
    chapter = plot_laws(d)
    assert chapter is not None
    energy = chapter.plots[0]
    assert len(energy.traces[0].x) == curves.SPANS_UPPER
    assert len(format_bundle("x", shorten_plots([energy], {}))) < 1600  # 400 of them are titles and axes
    many = dataclasses.replace(energy, traces=[dataclasses.replace(energy.traces[0], words=[HOSTILE * 9] * 240)] * 5)
    assert len(format_bundle("x", shorten_plots([many], {}))) < 7000


def test_scripts_of_data_cannot_be_left():
    """Not by an end of script, not by a line that only some count as one."""
    made = format_script("x", {HOSTILE: "</script>\u2028"})
    assert "</" not in made and "\u2028" not in made
    assert json.loads(made[made.index(" = ") + 3 : made.rindex(";")]) == {HOSTILE: "</script>\u2028"}


def test_slope_of_growth_is_that_of_the_data(tmp_path):
    """CPU per step proportional to the number of bodies: slope 1; a failure does not count."""
    for n in (3, 6, 12, 24):
        put(tmp_path, make_measured_record(f"n{n:02}", problem_parameters=f'{{"links": {n}}}', cpu_median_s=0.01 * n))
    far = make_measured_record("n99", status="diverged", problem_parameters='{"links": 99}', cpu_median_s=1e9)
    put(tmp_path, far)
    results = read_results(tmp_path)
    bodies = {c.record.run_id: int(c.record.run_id[1:]) for c in results.runs}
    (found,) = measure_growths(results.runs, bodies)
    assert found.bodies == (3, 6, 12, 24)
    assert found.fit[0] == pytest.approx(1.0)
    assert not measure_growths(results.runs[:2], bodies)  # two sizes are no evidence


def test_text_of_files_is_plain_in_figures():
    """Nothing of it is mathematics."""
    assert paper.strip_math("a$b") == r"a\$b"


@pytest.mark.parametrize("decades", [0.5, 0.97, 1.5, 3.0, 30.0])
@pytest.mark.parametrize("low", [1.05e-5, 2.1e-5, 3.3e-5, 9.1e-5])
def test_labels_of_a_printed_log_axis_do_not_overlap(low, decades):
    """In the width of one column, from half a decade to thirty; there is always a label."""
    with paper.apply_style():
        figure = paper.sheet(paper.SINGLE, 2.0)
        ax, canvas = figure.add_subplot(), FigureCanvasAgg(figure)
        paper.set_log_axis(ax, "x")
        ax.set_xlim(low, low * 10.0**decades)
        canvas.draw()
        ticks = [*ax.xaxis.get_major_ticks(), *ax.xaxis.get_minor_ticks()]
        inside = [t.label1 for t in ticks if low <= t.get_loc() <= low * 10.0**decades and t.label1.get_text()]
        boxes = [label.get_window_extent(canvas.get_renderer()) for label in inside]
    assert boxes and not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


def test_a_path_that_turns_back_is_drawn(tmp_path):
    """It runs to smaller abscissas: the marks along it stay on it."""
    path = Trace("path", np.array([1.0, 0.5, 0.0]), np.zeros(3), "alpha")
    plot = Plot("paths", "Paths", "", Axis("X", "m"), Axis("Y", "m"), [path])
    draw_plots([plot], {"alpha": spec.LineStyle("#3D62C7", "o")}).savefig(tmp_path / "path.svg")


def test_panels_that_share_an_axis_show_all_of_each():
    """A limit on one side of the first must not fix the other before the second is drawn."""
    x, y = np.array([0.0, 1.0]), Axis("draws", low=0.0)
    plots = [Plot(f"p{k}", "", "", Axis("rank"), y, [Trace("a", x, top * x)]) for k, top in enumerate((1.0, 5.0))]
    assert all(ax.get_ylim()[1] >= 5.0 and ax.get_ylim()[0] == 0.0 for ax in draw_plots(plots, {}).axes)


COSTS = np.array([3.0, 1.0, 2.0])
NAMED = Plot(
    "costs",
    "Costs",
    "",
    Axis("CPU time", "s", low=0.0),
    Axis("solver", names=("gc_weak_form", "rattle", "ida_index1")),
    [Trace("cost", COSTS, np.arange(3.0), mode="markers", left=np.zeros(3), right=COSTS)],
)


def test_bars_stand_at_their_names_in_print():
    figure = draw_plots([NAMED], {})
    FigureCanvasAgg(figure).draw()
    (ax,) = figure.axes
    assert [t.get_text() for t in ax.get_yticklabels()] == list(NAMED.y.names)
    (bars,) = (c for c in ax.collections if hasattr(c, "get_segments"))
    ends = {round(float(s[0][1])): (float(s[0][0]), float(s[1][0])) for s in bars.get_segments()}
    assert ends == {0: (0.0, 3.0), 1: (0.0, 1.0), 2: (0.0, 2.0)}


def test_bars_stand_at_their_names_on_a_page(browser, report, tmp_path):
    """Their lengths are as the numbers, and each lies at the height of its name."""
    script = format_bundle("data/costs", shorten_plots([NAMED], {}))
    scripts = "".join(f'<script src="{report}/assets/{name}.js"></script>' for name in ("site", "plots"))
    figure = (
        '<figure><div class="canvas" data-plot="costs" data-from="data/costs" style="width: 500px; height: 200px">'
        '</div><div class="tools"></div><details class="numbers"><summary></summary><div></div></details></figure>'
    )
    page = tmp_path / "costs.html"
    page.write_text(f"<!doctype html><title>costs</title>{figure}<script>{script}</script>{scripts}")
    tab = browser.open(page)
    tab.until("window.MBS?.plotted")
    found = json.loads(
        tab.evaluate(
            """(() => {
              const box = document.createElement("div");
              box.innerHTML = MBS.plotted.svg("costs");
              const all = (what) => [...box.querySelectorAll(what)];
              const heights = Object.fromEntries(all("text").map((t) => [t.textContent, +t.getAttribute("y")]));
              const numbers = (path) => path.getAttribute("d").match(/[\\d.]+/g).map(Number);
              const bars = all("path[stroke-width='4']").map(numbers);
              return JSON.stringify({ heights, bars });
            })()"""
        )
    )
    assert len(found["bars"]) == 3
    for name, (_, y, _) in zip(NAMED.y.names, found["bars"], strict=True):
        assert abs(found["heights"][name] - 4 - y) < 0.2
    lengths = np.array([b - a for a, _, b in found["bars"]])
    assert lengths / lengths[1] == pytest.approx(COSTS, abs=0.02)
