"""Every number of the first page is recomputed from ``runs.parquet`` and the series: hero, race, heat map, cards."""

import json
import math
import re
from collections import Counter

import numpy as np
import pandas as pd
import pytest

from mbsbench.harness.base.files import write_text
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.mechanics.types import Law
from mbsbench.harness.results import store
from mbsbench.harness.results.judgements.files import PUBLISHED
from mbsbench.harness.results.reproduce import write_command
from mbsbench.reports import site
from mbsbench.reports.mechanism.stage import FRAMES
from mbsbench.reports.model.margin import find_margin
from mbsbench.reports.model.results import read_results
from mbsbench.reports.model.words import format_count as count
from mbsbench.reports.model.words import number, seconds, time
from mbsbench.reports.pages.runs.overview import ENGINES
from mbsbench.tests.factories import make_measured_record

from .browser import OVERFLOW
from .conftest import because, put
from .outline import Outline
from .test_heat import broken, moving

MOST_BYTES = 500_000
PROBLEMS = ("hard", "easy")
ORDERS = {"alpha": 4.0, "beta": 2.0, "gamma": 2.0}
COST = {"alpha": 3e-3, "beta": 1e-3, "gamma": 9e-3}
STEPS = [0.08 / 2**k for k in range(5)]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Ladders of three solvers on two problems: error (dt)^p, CPU c / dt; delta claims success and is wrong on one."""
    folder = tmp_path_factory.mktemp("first")
    for name in PROBLEMS:
        for solver, order in ORDERS.items():
            for k, dt in enumerate(STEPS):
                put(
                    folder,
                    make_measured_record(
                        f"{name}{solver}{k}",
                        solver,
                        problem=name,
                        dt_s=dt,
                        position_error_max_m=dt**order,
                        cpu_median_s=COST[solver] / dt,
                        energy_drift_max_J=1e-3 * dt**order,
                        paper_label="ODE-GC" if solver == "beta" else "",
                    ),
                    moving(k),
                )
    put(
        folder,
        make_measured_record(
            "hardwrong",
            "delta",
            problem="hard",
            dt_s=0.01,
            position_error_max_m=0.4,
            cpu_median_s=0.05,
            accurate_until_s=0.5,
            **broken(Law.ENERGY, 0.45, 0.1, "J"),
        ),
        moving(9),
    )
    put(
        folder,
        make_measured_record(
            "easydelta",
            "delta",
            "refused",
            problem="easy",
            claimed="refused",
            message="no",
            position_error_max_m=math.nan,
            cpu_median_s=math.nan,
        ),
    )
    write_text(folder / "environment.json", "{}")
    store.write_table(folder, store.load(folder).records)
    return site.build_report(folder), pd.read_parquet(folder / "runs.parquet")


def cost(table: pd.DataFrame, problem: str, solver: str, target: float) -> float:
    """CPU time at an error: on the power law between two steps, least of those below the first."""
    own = table[(table.problem == problem) & (table.solver == solver) & (table.status == "success")]
    own = own.sort_values("dt_s", ascending=False)
    errors, cpu = own.position_error_max_m.to_numpy(), own.cpu_median_s.to_numpy()
    if not len(own) or errors.min() > target:
        return math.nan
    if errors[0] <= target:
        return float(cpu[0])
    return float(np.exp(np.interp(-math.log(target), -np.log(errors), np.log(cpu))))


@pytest.fixture
def tab(built, browser):
    """The first page, once its scripts have run."""
    tab = browser.open(built[0])
    tab.until("window.MBS && MBS.first")
    yield tab
    tab.close()


@pytest.mark.browser
@pytest.mark.parametrize("problem", range(2))
def test_the_race_is_that_of_the_table(built, tab, problem):
    """At every error of the slider: who gets there, in which order, at what CPU time and ratio; the others and why."""
    _, table = built
    name = tab.evaluate(f"(MBS.first.choose({problem}), MBS.first.data.costs[{problem}].slug)")
    rows = """[...document.querySelectorAll('[data-bars] li')].map((e) => [e.dataset.solver,
        e.querySelector('span').textContent, e.className.includes('missed')])"""
    for k, target in enumerate(tab.evaluate(f"MBS.first.data.costs[{problem}].targets")):
        tab.evaluate(
            f"(() => {{ const s = document.querySelector('[data-target]'); s.value = {k};"
            "s.dispatchEvent(new Event('input')); })()"
        )
        shown = tab.evaluate(rows)
        expected = {s: cost(table, name, s, target) for s in ("alpha", "beta", "gamma", "delta")}
        there = sorted((c, s) for s, c in expected.items() if c == c)
        assert [s for s, _, missed in shown if not missed] == [s for _, s in there]
        for (cpu, _), (_, text, _) in zip(there, shown, strict=False):
            assert text.removeprefix("≤ ") == f"{seconds(cpu)} ×{number(cpu / there[0][0], 2)}"
        command = tab.evaluate("document.querySelector('[data-command]').textContent")
        assert command == f"mbsbench advise {name} --error {target:.0e}".replace("e-0", "e-")
    assert tab.faults == [] and tab.requests == []


@pytest.mark.browser
def test_the_heat_map_at_equal_error_and_at_equal_cost(built, tab):
    """Ratios of the race; the smallest error within ten times the cheapest."""
    _, table = built
    target = tab.evaluate("MBS.first.data.costs[MBS.first.state.race].targets[MBS.first.state.target]")
    cells = """Object.fromEntries([...document.querySelectorAll('.heat tbody tr')].map((r) => [r.dataset.solver,
        [...r.cells].slice(1, 3).map((c) => c.textContent)]))"""
    slugs = tab.evaluate("[...document.querySelectorAll('.heat thead th')].map((h) => h.dataset.slug).filter(Boolean)")
    for mode in ("error", "cost"):
        tab.evaluate(f"document.querySelector('[data-mode={mode}]').click()")
        shown = tab.evaluate(cells)
        for k, problem in enumerate(slugs):
            all_of = {s: cost(table, problem, s, target) for s in shown}
            first = np.nanmin(list(all_of.values()))
            for solver, texts in shown.items():
                own = table[(table.problem == problem) & (table.solver == solver) & (table.status == "success")]
                near = own[own.cpu_median_s <= 10.0 * first].position_error_max_m
                if mode == "error":
                    value = all_of[solver]
                    assert texts[k] == (f"×{number(value / first, 2)}" if value == value else "–")
                else:
                    assert texts[k] == (number(near.min(), 1) if len(near) else "–")
    reached = re.match(r"(\d+) of (\d+)", tab.evaluate("document.querySelector('[data-heat-title]').textContent"))
    assert reached and int(reached[2]) == 8
    tab.evaluate("document.querySelector('[data-mode=limit]').click()")
    assert "stay" in tab.evaluate("document.querySelector('[data-heat-title]').textContent")


@pytest.mark.browser
def test_a_cell_opens_a_drawer_and_a_column_sorts(built, tab):
    """No page change; the drawer has the cell's run, its command and its energy; empty cells stay last."""
    _, table = built
    cell = "document.querySelector('.heat tr[data-solver=alpha] td a')"
    tab.evaluate(f"{cell}.click()")
    drawer = tab.evaluate("document.querySelector('[data-drawer]').textContent")
    slug = tab.evaluate("document.querySelector('.heat thead th[data-slug]').dataset.slug")
    finest = table[(table.problem == slug) & (table.solver == "alpha")].sort_values("dt_s").iloc[0]
    assert f"mbsbench solve {slug} alpha" in drawer and seconds(finest.cpu_median_s) in drawer
    assert f"{number(finest.energy_drift_max_J)} J" in drawer and tab.evaluate("location.pathname").endswith(
        "index.html"
    )
    tab.evaluate("document.querySelector('[data-mode=error]').click()")
    tab.evaluate("document.querySelector('.heat thead th[data-slug] .sorter').click()")
    order = tab.evaluate("[...document.querySelectorAll('.heat tbody tr')].map((r) => r.cells[1].dataset.v)")
    values = [float(v) for v in order if v]
    assert values == sorted(values) and all(not v for v in order[len(values) :])


@pytest.mark.browser
def test_the_counter_is_the_error_of_the_series(tab):
    """Metres off at the time of the clock, for each run on the stage, and what each claims."""
    tab.until("window.MBS.onStage && MBS.onStage.play()")
    tab.evaluate("MBS.onStage.seek(1.0)")
    said = tab.evaluate("""[...document.querySelectorAll('[data-cast] li')].map((e) =>
        ['.solver', '[data-off]', '.mark'].map((s) => e.querySelector(s).textContent))""")
    plain = moving(0)
    expected = np.interp(1.0, plain.arrays["t"], plain.arrays["position_error"])
    for _, off, _ in said:
        value, unit = re.match(r"position error ([\d.]+) (mm|m)", off).groups()
        assert float(value) * {"mm": 1e-3, "m": 1.0}[unit] == pytest.approx(expected, rel=0.05)
    assert said[-1][0] == "delta" and said[-1][2] == "wrong" and {s for s, _, _ in said} == {"alpha", "beta", "delta"}


TEXTS = """(() => { const found = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walk.nextNode()) {
        const n = walk.currentNode, e = n.parentElement;
        if (/\\d/.test(n.data) && !e.closest("footer, pre, script, style"))
            found.push(n.data.replace(/\\s+/g, " ").trim());
    }
    return found; })()"""
AXIS = re.compile(r"(0\.0*)?1|10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+|10+")  # labels of an axis: powers of ten
PROSE = ("A dot is a statement of the 2022 paper that proposes",)


def shown(table: pd.DataFrame) -> set[str]:
    """Every text with a digit that the first page may have, from the table, the judgement and what is published."""
    ran, out = table[table.status != "refused"], set[str]()
    wrong = ran[ran.status == "wrong"]
    out.add(
        f"{table.solver.nunique()} solvers on {table.problem.nunique()} mechanisms whose exact motion is known: "
        f"{len(wrong)} of {len(ran)} runs reports success and is wrong."
    )
    out.add(
        f"{len(wrong)} of {len(ran)} runs reports success and is wrong; from other results, as published, one run "
        "each of Exudyn, Pinocchio and MuJoCo"
    )
    motion = moving(0).arrays
    picture = np.linspace(0.0, motion["t"][-1], FRAMES)[round(1.0 / motion["t"][-1] * (FRAMES - 1))]
    off = np.interp(picture, motion["t"], motion["position_error"])
    out |= {f"1.0 of {number(motion['t'][-1], 2)} s", f"position error {1e3 * off:.2f} mm"}
    out |= {"1 mm", f"{table.t_end_s.max():g} s"}
    roles = ("among the cheapest accurate", "the paper's", "a false success")
    out |= {f"{role}, dt = {dt:g} s" for role in roles for dt in table.dt_s}
    out |= race_of(table, "hard", 1e-3)
    titles, ratios = [], []
    for problem, missed in (("hard", "; 1 of 4 do not get there"), ("easy", "")):
        all_of = sorted((cost(table, problem, s, 1e-4), s) for s in ORDERS)
        ratio = number(all_of[-1][0] / all_of[0][0], 2)
        titles.append(all_of[0][1])
        ratios += [c / all_of[0][0] for c, _ in all_of]
        out.add(
            f"{problem}: {all_of[0][1]} needs {seconds(all_of[0][0])} for 10⁻⁴ m, {all_of[-1][1]} {ratio} times "
            f"as much{missed}"
        )
        out |= {f"cost ×{ratio} the cheapest at 10⁻⁴ m"}
    middle = number(sorted(ratios)[len(ratios) // 2], 2)
    out.add(
        f"At 10⁻⁴ m, {titles[0]} is cheapest on {titles.count(titles[0])} of {len(titles)} problems; the median "
        f"of those that get there costs {middle} times the cheapest"
    )
    finest = table.sort_values("dt_s").groupby(["problem", "solver"]).first().reset_index()
    for r in finest.itertuples():
        part = r.energy_drift_max_J / 0.1
        out |= {number(part, 2 if part >= 0.1 else 1), f"{r.solver} on {r.problem}, dt = {r.dt_s:g} s: refused: no"}
        out.add(
            f"{r.solver} on {r.problem}, dt = {r.dt_s:g} s: success: the energy error is "
            f"{number(r.energy_drift_max_J)} of {number(0.1)} J allowed"
        )
        out |= {f"dt = {r.dt_s:g} s", time(r.t_reached_s), count(r.steps), count(r.evaluations), number(r.cpu_median_s)}
        out |= {number(x) for x in (r.energy_drift_max_J, r.position_error_max_m, r.phi_max, r.phi_dot_max)}
    for problem in PROBLEMS:
        ends = Counter(finest[finest.problem == problem].status)
        words = {"success": "succeeded", "wrong": "wrong", "refused": "refused"}
        out.add(" and ".join(f"{ends[k]} {word}" for k, word in words.items() if ends[k]))
    within = (finest.assign(well=finest.status == "success").groupby("solver").well.sum()).to_dict()
    out |= {f"{n} of {table.problem.nunique()}" for n in within.values()}
    out.add(
        f"{sum(n == 2 for n in within.values())} of {len(within)} solvers stay within every limit on all 2 problems, "
        "each at its finest setting"
    )
    out |= {f"≤ {edge}" for edge in ("10⁻⁴", "0.001", "0.01", "0.1", "1", "1.5", "4")}
    for r in wrong.itertuples():
        (reason,) = json.loads(r.wrong_because)
        words = f"the energy error reaches {reason['value']:g} J, more than {reason['limit']:g} J"
        out |= {words, f"{r.solver} on {r.problem}, dt = {r.dt_s:g} s: wrong: {words}"}
        out.add(number(reason["value"] / reason["limit"], 2))
        setting = f"dt = {r.dt_s:g} s"
        out |= card_of("the energy error", reason, setting, r.t_end_s) | {f"Drawn at {number(r.t_end_s)} s."}
        out.add(f"✗ 1 of 1 run reports success and is wrong, finest {setting}")  # why it has no bar
        out.add(f"It is judged like this run of {r.solver}, {setting}, on {r.problem}, and gets its row above.")
        out.add(f"mbsbench solve {r.problem} {r.solver} --set dt={r.dt_s:g} --out {r.run_id}.npz")
        out |= {f"{r.solver}: {r.accurate_until_s:g} s (10 %)", "0 →", "0 of 1 run follows the exact motion to its end"}
    for c in read_results(ENGINES).runs:
        first = find_margin(c).error
        law = {"constraint": "|phi|", "energy": "the energy error"}.get(str(first.law), "|R^T R - 1|")
        place = f"{c.record.solver} on {c.variant}, {c.settings()}"
        out |= card_of(law, vars(first), place, c.record.t_reached_s) | {write_command(c.record)}
    accused = wrong.solver.nunique() + len({c.record.solver for c in read_results(ENGINES).runs})
    out.add(
        f"{min(accused, 6)} of {accused} solvers with such runs, other people's code first. Of each, the run farthest "
        "over its limit at default options in the group “recommended”, or at others where it has none there; drawn "
        "over the exact motion in ink. Other settings of it may be right. All:"
    )
    out.add("≈ inaccurate: no law broken, off the exact motion by more than 10 % of the reach")
    claims = [c for c in json.loads((PUBLISHED.path / "claims.json").read_text())["claims"] if c["kind"] == "result"]
    verdict = Counter((c["paper"] or c["beyond"])["verdict"] for c in claims)
    out.add(
        f"Of the claims of Natsiavas et al. (2022) {verdict['reproduced']} are reproduced, "
        f"{verdict['reproduced if']} on a condition, {verdict['not reproduced']} are not; "
        f"of {verdict['cannot be told']} it cannot be told"
    )
    return out | {c["claim"] for c in claims} | {f"Sect. {c['section']}" for c in claims} | {*PROSE}


def race_of(table: pd.DataFrame, problem: str, target: float) -> set[str]:
    """The words of the race at an error: the answer, a bar for each solver, the command."""
    all_of = sorted((cost(table, problem, s, target), s) for s in ORDERS)
    coarse = {s: table[(table.problem == problem) & (table.solver == s)].position_error_max_m.max() for s in ORDERS}
    bound = {s: coarse[s] <= target for s in ORDERS}
    (least, best), others = all_of[0], table[table.problem == problem].solver.nunique() - len(ORDERS)
    assert not bound[best]
    said = f"{best} needs {seconds(least)} of CPU time; {others} of {len(ORDERS) + others} solvers do not get there."
    note = f"Its exact motion is computed by two formulations until they agree; this answer is of {problem}, 1 mm."
    return {
        said,
        note,
        f"mbsbench advise {problem} --error 1e-3",
        *(f"{'≤ ' if bound[s] else ''}{seconds(c)} ×{number(c / least, 2)}" for c, s in all_of),
    }


def card_of(law: str, reason: dict, setting: str, reached: float) -> set[str]:
    """The words of a false success: setting and time, what breaks which limit how far, and since when."""
    value, limit = (f"{number(reason[k])} {reason['unit']}".strip() for k in ("value", "limit"))
    at = float(reason["time_s"])
    first = "" if math.isnan(at) else f", first at {number(at)} s"
    times = number(reason["value"] / reason["limit"], 2)
    claim = f"{setting}, claims success over {time(reached)} s;"
    return {claim, f", {claim}", f"{law} reaches {value}, {times} times the {limit} allowed{first}"}


@pytest.mark.beyond_core
@pytest.mark.browser
def test_every_text_with_a_digit_is_recomputed(built, tab):
    """The whole page is walked, whatever is added to it; only code samples and the footer's provenance are left out."""
    tab.until("window.MBS.onStage && MBS.onStage.play()")
    tab.evaluate("MBS.onStage.seek(1.0)")
    tab.evaluate("[...document.querySelectorAll('.plots .canvas')].forEach((e) => e.scrollIntoView())")
    found, allowed = tab.evaluate(TEXTS), shown(built[1])
    assert len(found) > 60
    assert [t for t in found if t not in allowed and not AXIS.fullmatch(t)] == []


@pytest.mark.beyond_core
def test_sentences_and_cards_have_the_numbers_of_the_table(built):
    """Counts of the first line, the law of the false success with its ratio, who follows the motion to its end."""
    page, table = built
    text = " ".join(Outline(page.read_text(encoding="utf-8")).text.split())
    ran = table[table.status != "refused"]
    wrong = ran[ran.status == "wrong"]
    assert f"{table.solver.nunique()} solvers on {table.problem.nunique()} mechanisms" in text
    assert f"{len(wrong)} of {len(ran)} runs reports success and is wrong." in text
    (reason,) = json.loads(wrong.wrong_because.iloc[0])
    assert f"{number(reason['value'] / reason['limit'], 2)} times the {number(reason['limit'])} J allowed" in text
    assert f"1 of {len(ran)} runs reports success and is wrong; from other results" in text
    followed = table[table.accurate_until_s.notna()]
    known = np.minimum(followed.t_end_s, followed.reference_horizon_s)
    whole = int((followed.accurate_until_s >= 0.999 * known).sum())
    assert f"{whole} of {len(followed)} run follows the exact motion to its end" in text


def test_the_title_of_the_panels_is_recomputed(built):
    """Who is the cheapest on how many problems, at the error that the page states in each panel."""
    page, table = built
    html = page.read_text(encoding="utf-8")
    titles = re.findall(r"<figcaption><b>(\w+): (\w+) needs ([^<]*?) for (\S+) m, (\w+) ([\d.]+) times", html)
    assert len(titles) == 2
    for problem, first, shown, error, last, ratio in titles:
        target = float(error) if "⁻" not in error else 10.0 ** -int(error.removeprefix("10⁻").translate(DIGITS))
        within = pd.Series({s: cost(table, problem, s, target) for s in ORDERS}).dropna().sort_values()
        assert (first, last) == (within.index[0], within.index[-1]) and shown == seconds(within.iloc[0])
        assert ratio == number(within.iloc[-1] / within.iloc[0], 2)


DIGITS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789")


def test_the_first_page_is_light_and_asks_nobody(built):
    """All that it loads, in bytes; no address of a network."""
    page, _ = built
    html = page.read_text(encoding="utf-8")
    files = set(re.findall(r'(?:src|href)="((?:assets|data)/[^"]+\.(?:js|css))"', html))
    assert len(html.encode()) + sum((page.parent / f).stat().st_size for f in files) < MOST_BYTES
    assert not re.search(r"https?:", html.replace("http://www.w3.org/2000/svg", ""))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """As many solvers and problems as the suite `bench` with engines has; half of the solvers are wrong on one."""
    folder = tmp_path_factory.mktemp("whole")
    for k, solver in enumerate(sorted({spec.solver for spec in load_suite("bench_engines").specs})):
        for j in range(6):
            for n in range(3):
                motion = {
                    "problem": f"mechanism_{j}",
                    "dt_s": 0.1 / 2**n,
                    "position_error_max_m": 1e-2 / 4.0**n,
                    "cpu_median_s": 1e-3 * (k + 1) * 2**n,
                }
                bad = broken(Law.ENERGY, 0.45, 0.1, "J") if (j, n, k % 2) == (0, 0, 0) else {}
                put(
                    folder,
                    make_measured_record(f"{k}x{j}x{n}", solver, **motion, **bad),
                    moving(0) if (j, n) == (0, 0) else None,
                )
    write_text(folder / "environment.json", "{}")
    store.write_table(folder, store.load(folder).records)
    return site.build_report(folder)


@pytest.mark.sampled(0)
@pytest.mark.beyond_core
@pytest.mark.browser
@pytest.mark.parametrize(("width", "most"), [(1440, 4 * 900), (412, math.inf)])
def test_the_first_page_is_four_screens_and_fits_a_phone(whole, browser, width, most):
    tab = browser.open(whole, width=width)
    tab.until("window.MBS && MBS.first")
    assert tab.evaluate("document.documentElement.scrollHeight") <= most and tab.evaluate(OVERFLOW) == 0
    tab.close()


def test_a_wrong_run_without_size_has_its_card_too(tmp_path):
    """Another start, another symmetry: what has no number is told in words."""
    put(tmp_path, make_measured_record("aa01", "alpha", "wrong", wrong_because=because("far off")), moving(0))
    assert "far off" in site.build_report(tmp_path).read_text(encoding="utf-8")
