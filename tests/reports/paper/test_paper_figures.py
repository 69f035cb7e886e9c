"""The paper's figures: each is made, says what is missing, stars what stopped, and tells the numbers of the records."""

import dataclasses
import json
import math

import pytest

from mbsbench.harness.__main__ import main
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.suites.suite import load_suite
from mbsbench.reports.model.results import Run, read_results
from mbsbench.reports.model.words import number, signed
from mbsbench.reports.paper import build, drawer, lines, picking
from mbsbench.reports.paper.catalogue import FIGURES, NUMBERS
from mbsbench.reports.plots import palette
from mbsbench.reports.plots.style import style

from .conftest import fill

BY_NAME = {s.name: s for s in FIGURES}


def drawn(folder, name):
    """A figure and its lines, not written."""
    results, spec = read_results(folder), BY_NAME[name]
    chosen = picking.choose(spec.picks, results.runs)
    series = {c.run.record.run_id: results.series(c.run) for c in chosen if c.run}
    own = palette.looks({p.solver for p in spec.picks})
    with style():
        return drawer.draw(spec, chosen, series, own), lines.lines_of(chosen, series, own)


def legend(figure) -> str:
    return " ".join(" ".join(t.get_text() for t in k.get_texts()) for k in figure.legends).replace("\n", " ")


def test_every_run_that_a_figure_asks_for_is_in_the_suite():
    """Else a figure would say "not in this run" for ever."""
    runs = [
        Run(RunRecord(
            run_id="", settings_id=c.settings_id, case=c.case, problem=c.problem, solver=c.solver,
            problem_parameters=json.dumps(dict(c.parameters), default=list), solver_options=json.dumps(dict(c.options)),
            dt_s=math.nan if c.control.dt is None else c.control.dt,
            rtol=math.nan if c.control.rtol is None else c.control.rtol,
            max_step_s=math.nan if c.control.max_step is None else c.control.max_step,
        )) for c in load_suite("paper").specs
    ]  # fmt: skip
    absent = [picking.asked_for(p.pick) for s in FIGURES for p in picking.choose(s.picks, runs) if p.run is None]
    assert not absent


def test_catalogue_has_the_twelve_figures_as_printed():
    assert [s.number for s in FIGURES if s.variant == "as printed"] == list(NUMBERS)
    assert len({s.name for s in FIGURES}) == len(FIGURES)


@pytest.mark.parametrize("variant", ["as printed", pytest.param("recommended", marks=pytest.mark.slow)])
def test_every_figure_is_made(whole, variant):
    """With a caption each; the captions file is strict JSON, its numbers are the records'."""
    folder, records = whole
    specs = [s for s in FIGURES if s.variant == variant]
    build.build(folder, specs, suffixes=("png",))
    told = json.loads((folder / "paper" / "captions.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    by_name = {f["name"]: f for f in told["figures"]}
    for spec in specs:
        said = by_name[spec.name]
        assert said["title"] and said["files"] == [f"{spec.name}.png"]
        assert (folder / "paper" / f"{spec.name}.png").stat().st_size > 5000
        assert said["runs"] and all(c["found"] for c in said["runs"])
        for c in said["runs"]:
            own = records[c["run"]]
            assert c["energy_drift_max_J"] == own.energy_drift_max_J and c["t_reached_s"] == own.t_reached_s


def test_files_for_print_hold_their_fonts_and_do_not_change(whole, tmp_path):
    """TrueType in the PDF, paths in the SVG; the same records give the same bytes."""
    folder, _ = whole
    results = read_results(folder)
    first = build.one(results, BY_NAME["fig05"])
    content = {n: (folder / "paper" / n).read_bytes() for n in first.files}
    assert sorted(content) == ["fig05.pdf", "fig05.png", "fig05.svg"]
    assert b"/FontFile2" in content["fig05.pdf"] and b"/Type3" not in content["fig05.pdf"]
    assert b"<text" not in content["fig05.svg"]
    build.one(results, BY_NAME["fig05"])
    assert {n: (folder / "paper" / n).read_bytes() for n in first.files} == content


def test_missing_runs_are_said_on_figure_and_caption(tmp_path):
    """Never dropped in silence, not even when nothing is left."""
    fill(tmp_path, "fig04", "fig05", "fig12", without=("DAE-SE 0.001", "gc_weak_form"))
    figure, _ = drawn(tmp_path, "fig05")
    assert "DAE-SE (ndf_index1), rtol = 0.001: not in this run" in legend(figure)
    caption = build.one(read_results(tmp_path), BY_NAME["fig05"], ("png",))
    assert any(
        n.startswith("Not in this run: DAE-SE") and "ndf_index1 on spherical_pendulum" in n for n in caption.note
    )
    sketch, _ = drawn(tmp_path, "fig04")
    assert "not in this run" in " ".join(t.get_text() for t in sketch.axes[0].texts).replace("\n", " ")
    for path in (tmp_path / "runs").iterdir():
        path.unlink()
    empty, _ = drawn(tmp_path, "fig12")
    assert legend(empty).count("not in this run") == 2


def test_a_run_that_stopped_is_starred_where_it_stopped(tmp_path):
    """In every panel that reaches so far, and in words in legend and caption."""
    stop = {"status": "singular", "t_reached_s": 1.5, "message": "the matrix is singular"}
    records = fill(tmp_path, "fig06", **{"DAE-FI 0.001": stop})
    figure, _ = drawn(tmp_path, "fig06")
    run = next(c for c, r in records.items() if r.status == "singular")
    stars = [line for ax in figure.axes for line in ax.get_lines() if line.get_gid() == f"star-{run}"]
    assert len(stars) == 4 and all(s.get_xdata()[0] == pytest.approx(1.5) for s in stars)
    assert "★ singular at 1.5 s" in legend(figure)
    caption = build.one(read_results(tmp_path), BY_NAME["fig06"], ("png",))
    assert any("stops at 1.5 s, singular (the matrix is singular)" in n for n in caption.note)


def test_what_ends_otherwise_than_in_the_paper_is_told(tmp_path, whole):
    """Sect. 5.2: DAE-FI fails at 5.5 s (Fig. 7) and runs through in Fig. 6."""
    ran = build.one(read_results(whole[0]), BY_NAME["fig07"], ("png",))
    assert (
        len(ran.differs) == 1 and "DAE-FI failed at about 5.5 s" in ran.differs[0] and "reaches 40 s" in ran.differs[0]
    )
    stop = {"status": "diverged", "t_reached_s": 5.4, "message": "too large"}
    fill(tmp_path, "fig06", "fig07", **{"DAE-FI 0.001": stop})
    results = read_results(tmp_path)
    assert build.one(results, BY_NAME["fig07"], ("png",)).differs == []
    assert any("DAE-FI ran through" in d for d in build.one(results, BY_NAME["fig06"], ("png",)).differs)


def test_numbers_of_notes_are_those_of_the_records(whole):
    """Drift of Fig. 12, in the note and as a number beside it; steps, errors and observables likewise."""
    folder, records = whole
    results = read_results(folder)
    grid = build.one(results, BY_NAME["fig12"], ("png",))
    own = {c["key"]: records[c["run"]] for c in grid.runs}
    drift = next(f for f in grid.facts if "energy drift at most 1 J" in f["text"])
    for key, values in drift["values"].items():
        assert values == {n: getattr(own[key], n) for n in ("energy_drift_max_J", "energy_drift_end_J")}
        assert (
            f"at most {number(own[key].energy_drift_max_J)} J, {signed(own[key].energy_drift_end_J)} J" in drift["text"]
        )
    top = build.one(results, BY_NAME["fig11"], ("png",))
    by_key = {c["key"]: records[c["run"]] for c in top.runs}
    away = next(f for f in top.facts if "coincide" in f["text"])
    for key, values in away["values"].items():
        assert values["max"] == json.loads(by_key[key].observable_errors)["theta"]["max"]
    step = next(f for f in top.facts if "four orders" in f["text"])
    assert step["values"]["DAE-SE 0.0001"]["step_min_s"] == by_key["DAE-SE 0.0001"].step_min_s
    assert "(3.0 decades)" in step["text"]


def test_a_solver_has_its_colour_and_its_settings_dashes(whole):
    """Colours of the palette; the finest tolerance is solid, as in the report."""
    _, own = drawn(whole[0], "fig02")
    fi = [k for k in own if k.chosen.pick.solver == "ida_index1"]
    assert {k.look for k in fi} == {palette.looks(["ida_index1"])["ida_index1"]}
    assert len({k.dash for k in fi}) == 3
    assert min(fi, key=lambda k: k.chosen.pick.rtol).dash == palette.DASHES[0]


def test_a_damaged_series_is_said(tmp_path):
    """The record is there, its file is not what was recorded."""
    records = fill(tmp_path, "fig12")
    run = next(c for c, r in records.items() if '"loop"' in r.solver_options)
    (tmp_path / "series" / f"{run}.npz").write_bytes(b"not a file of numbers")
    build.build(tmp_path, [BY_NAME["fig12"]], ("png",))
    assert (tmp_path / "paper" / "fig12.png").exists()
    results, spec = read_results(tmp_path, check_series=False), BY_NAME["fig12"]
    chosen = picking.choose(spec.picks, results.runs)
    series = {c.run.record.run_id: build._series(results, c.run) for c in chosen}
    line = lines.lines_of(chosen, series, palette.looks({"gc_augmented_lagrangian"}))[0]
    assert drawer.label_of(line).endswith("its series cannot be read")


def test_one_figure_made_again_keeps_the_captions_of_the_others(tmp_path):
    fill(tmp_path, "fig08", "fig10")
    build.build(tmp_path, [BY_NAME["fig10"]], ("png",))
    build.build(tmp_path, [BY_NAME["fig08"]], ("png",))
    told = json.loads((tmp_path / "paper" / "captions.json").read_text(encoding="utf-8"))
    assert [f["name"] for f in told["figures"]] == ["fig08", "fig10"]


def test_a_run_run_again_takes_the_place_of_the_old_one(tmp_path, whole):
    """Two states of the code in one folder: the later counts."""
    record = next(iter(whole[1].values()))
    old, new = record, dataclasses.replace(record, run_id="f" * 16, finished="2026-02-02")
    pick = next(p for s in FIGURES for p in s.picks if picking.fits(p, Run(record)))
    assert picking.choose([pick], [Run(new), Run(old)])[0].run.record is new
    limited = dataclasses.replace(new, max_steps=500, finished="2026-03-03")
    roomy = dataclasses.replace(new, max_steps=10**7)
    assert picking.choose([pick], [Run(limited), Run(roomy)])[0].run.record is roomy
    assert not picking.fits(pick, Run(dataclasses.replace(record, max_step_s=0.5)))
    assert not picking.fits(pick, Run(dataclasses.replace(record, problem_parameters='{"gravity": 1.0}')))


def test_judged_claims_of_a_figure_stand_in_its_caption(tmp_path):
    """By the number of their figure; a broken file is no claim."""
    fill(tmp_path, "fig09", "fig12")
    (tmp_path / "judgement").mkdir()
    found = [{"id": "a", "figure": "Fig. 9a", "claim": "x", "verdict": "REFUTED", "because": "y"},
             {"id": "b", "figure": "Figs. 2, 3", "verdict": "SUPPORTED"}, {"id": "c", "figure": 12}]  # fmt: skip
    path = tmp_path / "judgement" / "claims.json"
    path.write_text(json.dumps(found), encoding="utf-8")
    results = read_results(tmp_path)
    assert [c["id"] for c in build.one(results, BY_NAME["fig09"], ("png",)).claims] == ["a"]
    assert [c["id"] for c in build.one(results, BY_NAME["fig12"], ("png",)).claims] == ["c"]
    path.write_text("[{", encoding="utf-8")
    assert build.one(results, BY_NAME["fig09"], ("png",)).claims == []


def test_command_writes_one_figure_or_says_what_there_is(whole, capsys):
    folder = str(whole[0])
    assert main(["figures", folder, "--paper", "--only", "fig08"]) == 0
    assert "fig08" in capsys.readouterr().out and (whole[0] / "paper" / "fig08.pdf").exists()
    assert main(["figures", folder, "--paper", "--only", "fig13"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: no figure 'fig13'") and said.count("\n") == 1
