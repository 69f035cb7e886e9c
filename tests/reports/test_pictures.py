"""Pictures of the README are drawn from the code that is here."""

import re
import sys
from pathlib import Path

import pytest

from mbsbench import solve
from mbsbench.harness.judge.referee.carried import is_current_or_carried, is_measuring_carried
from mbsbench.harness.mechanics.types import ALLOWED, Law
from mbsbench.harness.results.column_digests import read_stored_digests
from mbsbench.harness.results.records import parse_reasons
from mbsbench.reports.model.results import read_results
from mbsbench.reports.model.words import number
from mbsbench.tests.factories import make_measured_record
from mbsbench.tests.stale import REMEDY

from .conftest import put

pytestmark = pytest.mark.published
ROOT = Path(__file__).parents[2]
IMAGES = ROOT / "docs" / "images"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


@pytest.fixture(scope="module")
def pictures():
    sys.path.insert(0, str(ROOT / "docs"))
    import draw_pictures

    sys.path.pop(0)
    return draw_pictures


@pytest.mark.parametrize("name", ["costs", "chain"])
def test_pictures_of_results_are_of_runs_by_this_code(pictures, name):
    """The runs they are drawn from take minutes, so that the digest of its code stands for it."""
    comment = r"<!-- code of its runs: (\w+)(?:, measured by (\w+))? -->"
    (code,) = re.findall(comment, (IMAGES / f"{name}.svg").read_text(encoding="utf-8"))
    assert code in pictures.list_present_digests(), f"docs/images/{name}.svg: {REMEDY}"


def test_false_successes_of_engines_are_of_this_code(pictures):
    """Pages of results without engines show them: one an engine, each with its law and by how much."""
    runs = read_results(pictures.ENGINES).runs
    assert {c.record.solver for c in runs} == {"mujoco", "exudyn", "pinocchio"}
    for r in (c.record for c in runs):
        assert (r.claimed, r.status) == ("success", "wrong") and parse_reasons(r.wrong_because)
        assert is_current_or_carried(r.problem, r.solver, r.code), f"{r.case} of results/published/engines: {REMEDY}"
        assert is_measuring_carried(r.measured_by, read_stored_digests(pictures.ENGINES)), f"{r.case}: {REMEDY}"


def test_the_picture_of_costs_names_engines_with_their_cpu_time(pictures, tmp_path):
    """The cheapest, every engine and those that do not get there; the title has the least and the largest ratio."""
    cpu = {"rattle": 1e-3, "mujoco": 5e-3, "exudyn": 40e-3, "pinocchio": 20e-3}
    for solver, least in cpu.items():
        for k in range(3):
            put(
                tmp_path,
                make_measured_record(
                    f"{solver}{k}",
                    solver,
                    dt_s=0.1 / 2**k,
                    cpu_median_s=least * 2**k,
                    position_error_max_m=(1.0 if solver == "exudyn" else 1e-2) / 16.0**k,
                ),
            )
    drawn = pictures.draw_costs(read_results(tmp_path))
    (low, high) = re.search(r"engines that get there need ([\d.]+) to ([\d.]+) times", drawn).groups()
    assert (low, high) == ("5.0", "20")
    assert "not reached by Exudyn at any setting tried" in drawn
    for solver in ("rattle", "mujoco", "pinocchio"):
        assert re.search(f"<title>{solver} [0-9.]+ ms</title>", drawn)
    assert re.search(r">rattle [\d.]+ ms<", drawn) and re.search(r">MuJoCo [\d.]+ ms<", drawn)


def apart(one: str, other: str) -> float:
    """The largest difference of numbers of two pictures whose words are the same: coordinates are whole pixels."""
    assert NUMBER.sub("", one) == NUMBER.sub("", other), "make pictures"
    pairs = zip(NUMBER.findall(one), NUMBER.findall(other), strict=True)
    return max(abs(float(a) - float(b)) for a, b in pairs)


def test_the_loop_is_drawn_from_runs_of_this_code(pictures):
    """No number is off by more than a last digit, which rounding may turn."""
    assert apart((IMAGES / "loop.svg").read_text(encoding="utf-8"), pictures.draw_loop()) <= 1.0, "make pictures"


def test_the_loop_ends_while_its_motions_are_predictable(pictures, monkeypatch):
    """A tolerance changed by 1e-13 of itself, as rounding changes a step, is not seen."""
    drawn = pictures.draw_loop()
    roles = [(name, dt, rtol and rtol * (1.0 + 1e-13), words) for name, dt, rtol, words in pictures.ROLES]
    monkeypatch.setattr(pictures, "ROLES", roles)
    assert apart(drawn, pictures.draw_loop()) <= 1.0


def test_the_caption_of_the_loop_names_its_setting_and_has_its_numbers(pictures):
    """Problem, solver, tolerance, time, error and limit; and what a tighter tolerance gives."""
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    (name, _, rtol, words), end = pictures.ROLES[1], pictures.END
    bad, fair = (solve(pictures.PROBLEM, name, t_end=end, rtol=r).record for r in (rtol, 1e-6))
    assert (bad.claimed, bad.status) == ("success", "wrong") and fair.status == "success"
    energy = [number(v, 2) for v in (bad.energy_drift_max_J, ALLOWED[Law.ENERGY] * bad.energy_scale_J)]
    assert f"A chain falls for {end:g} s" in readme and "with rtol = 1e-5 reports success" in readme
    off = f"off by {energy[0]} J, more than a tenth of the energy that moves ({energy[1]} J), so we call it wrong."
    assert off in readme and ALLOWED[Law.ENERGY] == 0.1
    assert f"With rtol = 1e-6 it breaks no law and is {number(1e3 * fair.position_error_max_m, 2)} mm off." in readme
    drawn = (IMAGES / "loop.svg").read_text(encoding="utf-8")
    assert all(f">{role}, {setting}<" in drawn for role, *_, setting in pictures.ROLES) and "rtol = 1e-5" in words
    assert f"energy error {energy[0]} J of {energy[1]} J allowed" in drawn


def test_the_loop_lasts_six_seconds_and_shows_the_last_moment_without_animation(pictures):
    """A reader that moves nothing sees the end: every path and count stands on its last value."""
    drawn = pictures.draw_loop()
    assert set(re.findall(r'dur="(\w+)"', drawn)) == {"6s"}
    ends = re.findall(r' d="([^"]+)"><animate[^>]* values="([^"]+)"', drawn)
    assert len(ends) == 1 + len(pictures.ROLES) and all(one.endswith(f";{still}") for still, one in ends)
    shown = re.findall(r'opacity="1">position error ([\d.]+) mm', drawn)
    assert len(shown) == 2 and 10.0 * float(shown[0]) < float(shown[1])
