"""The theatre in a headless Chromium, from the disk: it draws, plays, jumps to the star, fits a phone."""

import numpy as np
import pytest

from mbsbench.reports.mechanism.theatre.poses import Poses, choose_poses, interpolate_poses
from mbsbench.reports.model.results import read_results
from mbsbench.tests.comparing import assert_close, assert_each, assert_same
from mbsbench.tests.factories import make_measured_record

from ..browser import LOW, SMALL
from ..conftest import put
from .conftest import staged_pages, two_bars

pytestmark = pytest.mark.browser
READY = "document.querySelector('[data-theatre]').dataset.ready"
STATS = "MBS.theatre.stats()"


@pytest.fixture
def open_(browser, staged):
    """Opens the page of the two bars at a time, and waits until it is drawn."""

    def page(at: str = "t=0", **size):
        tab = browser.open(f"{staged[1] / 'theatre-pendulum.html'}#{at}", **size)
        tab.until(READY)
        return tab

    return page


def faults(tab) -> list[str]:
    """Complaints of the console; not those of software drivers that reading pixels back is slow: the test does that."""
    return [f for f in tab.faults if "GL Driver Message" not in f]


@pytest.mark.parametrize(("width", "dark", "flat"), [(1280, False, False), (390, True, False), (390, False, True)])
def test_it_draws_without_network_or_complaint(open_, width, dark, flat):
    tab = open_("t=0.4&flat" if flat else "t=0.4&solid3d", width=width, dark=dark)
    assert tab.evaluate(READY) == ("flat" if flat else "solid")
    assert tab.ink("[data-canvas]", far=30) > 0.004  # bars are thin
    assert tab.ink("[data-strips]", far=30) > 0.01
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert width > 600 or (tab.evaluate(SMALL), tab.evaluate(LOW)) == ([], [])
    assert tab.evaluate("document.querySelector('[data-flat]').hidden") is not flat
    assert faults(tab) == [] and tab.requests == []


def test_axe_finds_no_violation(axe, staged):
    """Light and dark, on a desktop and a phone."""
    assert axe(f"{staged[1] / 'theatre-pendulum.html'}#t=0.4") == []


@pytest.mark.parametrize("at", ["t=0.4&solid3d", "t=0.4&solid3d&overlay"])
def test_draw_calls_do_not_grow_with_bodies(open_, at):
    """Instances: a mesh a player and kind of shape, the exact bars, and in each cell ground, supports and trails."""
    tab = open_(at)
    kinds = tab.evaluate("new Set(MBS['theatre-pendulum'].shapes.map((s) => s.kind)).size")
    players = tab.evaluate("MBS['theatre-pendulum'].players.length")
    cells = 1 if "overlay" in at else players
    assert 0 < tab.evaluate(f"{STATS}.calls") <= players * (kinds + 1) + cells * (1 + 2 + 1)


def test_a_processor_draws_lines_in_few_strokes(open_):
    """Pixels in 3-D cost it 18 ms a frame, these strokes 2: shapes of a kind are one path, however many."""
    tab = open_("t=0.4")
    assert (tab.evaluate(READY), tab.evaluate(f"{STATS}.renderer")) == ("flat", "2-D canvas")
    players = tab.evaluate("MBS['theatre-pendulum'].players.length")
    before = tab.evaluate(f"{STATS}.frames")
    tab.click("[data-play]")
    tab.until(f"{STATS}.frames > {before} + 5")
    assert 0 < tab.evaluate(f"{STATS}.calls") <= players * (2 + 2 + 2 + 1)  # ground, trails, bodies, exact bars


def test_a_visitor_adds_a_run_that_is_not_on_stage(browser, tmp_path):
    """Ten are; the eleventh has a file of its own, and the address keeps it."""
    for k in range(12):
        put(tmp_path, make_measured_record(f"a{k:02}", dt_s=0.01 / (k + 1)), two_bars(40, size=1e-3 * (k + 1)))
    results = read_results(tmp_path)
    page = staged_pages(results) / f"theatre-{results.variants[0].slug}.html"
    tab = browser.open(f"{page}#t=0.4")
    tab.until(READY)
    rows, choices = (f"document.querySelectorAll('{of}')" for of in ("[data-player]", "[data-add] option"))
    assert tab.evaluate(f"{rows}.length") == 10 and tab.evaluate(f"{choices}.length") == 1 + 2
    wanted = tab.evaluate(f"{choices}[1].value")
    tab.evaluate("""(() => { const s = document.querySelector("[data-add]"); s.selectedIndex = 1;
        s.dispatchEvent(new Event("change")); })()""")
    tab.until(f"{rows}.length === 11 && {READY}")
    name = page.stem
    assert tab.evaluate(f"MBS['{name}'].players[10].run") == wanted and wanted in tab.evaluate("location.hash")
    assert tab.evaluate(f"{rows}[10].querySelector('a').href").endswith(f"{wanted}.html")
    assert tab.evaluate("[...document.querySelectorAll('.labels span')].filter((e) => !e.hidden).length") == 11
    assert tab.evaluate(f"{STATS}.t") == 0.4 and faults(tab) == []
    tab.close()


@pytest.mark.parametrize("flat", ["&solid3d", "&flat"], ids=["3-D", "lines"])
def test_runs_stand_side_by_side_until_one_asks_for_an_overlay(open_, flat):
    """A cell a run, each drawn in; over each other they leave the rest of the stage as it is."""
    tab = open_(f"t=0.4{flat}")
    names = "[...document.querySelectorAll('.labels span')].filter((e) => !e.hidden)"
    assert tab.evaluate(f"{names}.length") == 4
    pixels = tab.screenshot(selector="[data-canvas]").astype(int)
    boxes = tab.evaluate(f"{names}.map((e) => [e.offsetLeft, e.offsetTop + e.offsetHeight, e.offsetWidth])")
    tall = min((b[1] for b in boxes if b[1] > boxes[0][1]), default=len(pixels) + 22) - 22 - boxes[0][1]
    for x, y, w in boxes:
        cell = pixels[y : y + tall, x : x + w]
        assert np.mean(np.abs(cell - cell[1, 1]).max(axis=-1) > 60) > 1e-3
    tab.click("[data-together]")
    assert tab.evaluate(f"{names}.length") == 0
    assert tab.evaluate("document.querySelector('[data-who]').hidden") is False
    assert faults(tab) == []


@pytest.mark.parametrize("at", ["t=0.9&solid3d", "t=0.9&flat", "t=0.9&overlay"])
def test_labels_never_hide_a_bar(open_, at):
    """With names and marks taken away, there is nothing where they were; elsewhere no pixel is another."""
    tab = open_(at)
    labels = "[...document.querySelectorAll('.labels *')].filter((e) => e.getClientRects().length)"
    boxes = tab.evaluate(
        f"{labels}.map((e) => [e, document.querySelector('[data-canvas]')].map((e) => e.getBoundingClientRect()))"
        ".map(([a, b]) => [a.x - b.x, a.y - b.y, a.width, a.height].map(Math.round))"
    )
    before = tab.screenshot(selector="[data-canvas]")
    tab.evaluate("document.querySelector('.labels').style.visibility = 'hidden'")
    after = tab.screenshot(selector="[data-canvas]")
    covered = np.zeros(after.shape[:2], dtype=bool)
    for x, y, w, h in boxes:
        covered[y : y + h, x : x + w] = True
    assert bool(boxes) == ("overlay" not in at) == bool(np.any(before != after))
    assert_same(before[~covered], after[~covered])
    assert len(np.unique(after[covered], axis=0)) <= 1


@pytest.mark.parametrize("flat", ["&solid3d", "&flat"], ids=["3-D", "lines"])
def test_the_exact_motion_is_in_ink_as_far_as_it_is_known(open_, flat):
    """It leaves the bars of the run; beyond its horizon nothing is black."""

    def black(t):
        tab = open_(f"t={t}&overlay{flat}")
        tab.evaluate("document.querySelector('[data-trail]').value = 'none'")
        tab.evaluate("document.querySelector('[data-trail]').dispatchEvent(new Event('change'))")
        tab.evaluate("new Promise((f) => setTimeout(f, 200))")
        return int(np.sum(tab.screenshot(selector="[data-canvas]").max(axis=-1) < 60))

    known, beyond = black(1.4), black(1.6)
    assert known > 150 and known > 10 * beyond


def test_play_moves_the_cursor_and_space_stops_it(open_):
    tab = open_()
    start = tab.evaluate("document.querySelector('[data-cursor]').style.transform")
    tab.click("[data-play]")
    tab.until(f"{STATS}.t > 0.05")
    tab.evaluate("document.activeElement.blur()")
    tab.press("Space")
    assert tab.evaluate(f"{STATS}.playing") is False
    assert tab.evaluate("document.querySelector('[data-cursor]').style.transform") != start
    t = tab.evaluate(f"{STATS}.t")
    tab.press("ArrowRight")
    assert tab.evaluate(f"{STATS}.t") > t
    tab.press("Home")
    assert tab.evaluate(f"{STATS}.t") == 0.0


def test_jumps_go_to_the_star_the_event_and_the_whip(open_):
    """Each at its time to the last digit, with its words."""
    tab = open_()
    stars = "[...document.querySelectorAll('.star')].filter((e) => !e.hidden).length"
    assert tab.evaluate(stars) == 0
    tab.click("[data-stop]")
    assert tab.evaluate(f"{STATS}.t") == 0.8
    tab.until(f"{stars} === 1")
    stops = "document.querySelector('[data-stops]')"
    assert "diverged" in tab.evaluate(f"{stops}.textContent")
    below = f"{stops}.getBoundingClientRect().top >= document.querySelector('.stage').getBoundingClientRect().bottom"
    assert tab.evaluate(below)
    assert "diverged: lost <script>" in tab.evaluate("document.querySelector('[data-note]').textContent")
    tab.click("[data-event]")
    assert tab.evaluate(f"{STATS}.t") == 0.5
    tab.click("[data-whip]")
    assert tab.evaluate(f"{STATS}.t") == pytest.approx(2.0 * 100 / 399)
    assert faults(tab) == []


def test_the_cursor_runs_over_no_title(open_):
    """Where it stands in the titles, the pixels are those without it; in each strip they are not."""
    tab = open_("t=0.05")
    strips = tab.evaluate("MBS['theatre-pendulum'].strips.length")
    find = "document.querySelector('[data-cursor]')"
    x = tab.evaluate(f"{find}.getBoundingClientRect().x - {find}.parentElement.getBoundingClientRect().x")
    column = slice(int(x), int(x) + 3)
    with_it = tab.screenshot(selector=".strips").astype(int)[:, column]
    tab.evaluate(f"{find}.style.visibility = 'hidden'")
    apart = np.abs(with_it - tab.screenshot(selector=".strips")[:, column]).max(axis=(1, 2)) > 30
    assert_each(apart[:18], "==", False)  # above the first strip
    assert np.sum(np.diff(apart.astype(int)) == 1) >= strips and apart.mean() > 0.4


def test_signs_above_the_slider_are_explained(open_):
    """Those that are there, with the words of their buttons."""
    tab = open_()
    signs = set(tab.evaluate("[...document.querySelectorAll('[data-ticks] i')].map((e) => e.textContent)"))
    key = tab.evaluate("document.querySelector('.transport .key').textContent")
    buttons = tab.evaluate("[...document.querySelectorAll('.transport button')].map((e) => e.textContent[0])")
    assert signs == {"★", "◆", "▼"} and signs <= set(key) and signs <= set(buttons)


def test_one_can_be_hidden_and_another_solid(open_):
    tab = open_("t=1.9")
    before = tab.screenshot(selector="[data-canvas]")
    tab.click("tr[data-player]:nth-child(2) [data-solid]")
    assert "beta" in tab.evaluate("document.querySelector('[data-who]').textContent")
    tab.click("[data-alone]")
    tab.until("document.querySelectorAll('[data-show]:checked').length === 1")
    assert np.any(before != tab.screenshot(selector="[data-canvas]"))


def test_reduced_motion_does_not_start_by_itself(open_):
    """Without a wish and without a time in the address it plays."""
    tab = open_("")
    assert tab.evaluate(f"{STATS}.playing") is True
    tab.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
    tab.call("Page.reload")
    tab.until(f"window.MBS && MBS.theatre && MBS.theatre.stats && {READY}")
    assert tab.evaluate(f"{STATS}.playing") is False and tab.evaluate(f"{STATS}.t") == 0.0


def test_the_page_has_the_poses_of_the_series(open_, staged):
    """Unpacked and interpolated in the page, against the series interpolated here: off by the grid of the int16."""
    results, _ = staged
    tab = open_()
    series = next(results.series(c) for c in results.runs if c.record.run_id == "a1")
    poses = Poses(series["frame_t"], series["frame_r"].astype(float), series["frame_q"])
    times = np.array([0.0, 0.1234, 1.0, 1.999, 2.0, 0.7])
    found = tab.evaluate(f"""(() => {{ const play = MBS["theatre-pendulum"];
        const m = new MBS.theatre.Motion(play.players.find((p) => p.run === "a1"), play);
        return {times.tolist()}.map((t) => [...m.at(t)]); }})()""")
    body = np.array(found).reshape(len(times), 2, 4, 3)
    wanted = interpolate_poses(poses.select_rows(choose_poses(poses, 2000, 1.0).rows), times)
    quantum = np.array(tab.evaluate('MBS["theatre-pendulum"].quantum'))
    assert_each(np.abs(body[:, :, 3] - wanted.r), "<=", 0.51 * quantum + 1e-6)  # the page holds float32
    x, y, z, w = np.moveaxis(wanted.q, -1, 0)
    first = np.stack((1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)), axis=-1)
    assert_close(body[:, :, 0], first, atol=2e-4)
