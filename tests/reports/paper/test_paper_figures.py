"""The paper's figures: each is made, names what is missing, stars what stopped, and shows the claims on it."""

import dataclasses
import json

import pytest
from msgspec.structs import replace

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.judge.referee.judge import write_judgements
from mbsbench.harness.results.judgements.claims import ClaimFinding, ClaimVerdict, CodeDigests
from mbsbench.harness.results.judgements.files import FOLDER, PUBLISHED, read_claims
from mbsbench.reports import site
from mbsbench.reports.model.claim_words import format_band
from mbsbench.reports.model.results import StoredRun, read_results
from mbsbench.reports.paper import build, captions, lines
from mbsbench.reports.paper.catalogue import FIGURES
from mbsbench.reports.plots import spec
from mbsbench.reports.plots.paper import SUFFIXES, apply_style

from .conftest import asked, fill, make_numbered_record, suite

BY_NAME = {s.name: s for s in FIGURES}


def drawn(folder, name):
    """A figure and its lines, not written."""
    results = read_results(folder, check_series=False)
    own = lines.match_runs(BY_NAME[name].picks, suite(), results.runs, results.readable_series)
    with apply_style():
        return build.draw_panels(BY_NAME[name], own, spec.choose_styles({k.asked.solver for k in own})), own


def one(folder, name, suffixes=("png",)):
    """The caption of a figure, which is written."""
    return build.draw_figure(read_results(folder), BY_NAME[name], suite(), suffixes)


def legend(figure) -> str:
    return " ".join(" ".join(t.get_text() for t in k.get_texts()) for k in figure.legends).replace("\n", " ")


def test_every_pick_finds_runs_in_the_suite():
    """Else a figure would miss a line without a word."""
    for figure in FIGURES:
        for pick in figure.picks:
            assert [s for s in pick.solvers if s not in {a.solver for a in lines.select_runs(pick, suite())}] == []


def test_of_recommended_runs_the_printed_step_and_the_smallest_tolerance_are_drawn():
    """The suite has the steps 0.01 and 0.005 s and the tolerances 1e-6 and 1e-8."""
    recommended = lines.select_runs(BY_NAME["fig06-recommended"].picks[0], suite())
    assert [s.control.dt or s.control.rtol for s in recommended] == [0.01, 1e-8, 1e-8, 1e-8, 1e-8]


def test_catalogue_has_the_twelve_figures_as_printed():
    assert [s.number for s in FIGURES if s.label == "as printed"] == list(range(1, 13))
    assert len({s.name for s in FIGURES}) == len(FIGURES)


def of_label(label: str, every: int = 1) -> list:
    return [f for f in FIGURES if f.label == label][::every]


@pytest.mark.sampled(0)
@pytest.mark.parametrize(
    "figures",
    [
        pytest.param(of_label("as printed", 4) + of_label("recommended", 6), id="some"),
        *(pytest.param(of_label(name), id=name, marks=pytest.mark.slow) for name in ("as printed", "recommended")),
    ],
)
def test_every_figure_is_made(whole, figures):
    """With a caption each; the captions file is strict JSON, its numbers are the records'."""
    folder, records = whole
    assert figures
    build.draw_figures(folder, [f.name for f in figures], suite(), suffixes=("png",))
    told = json.loads((folder / "paper" / "captions.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    by_name = {f["name"]: f for f in told["figures"]}
    for figure in figures:
        said = by_name[figure.name]
        assert said["title"] and said["files"] == [f"{figure.name}.png"]
        assert (folder / "paper" / f"{figure.name}.png").stat().st_size > 5000
        assert said["runs"] and all(c["run_id"] for c in said["runs"])
        for c in said["runs"]:
            own = records[c["run_id"]]
            assert c["numbers"]["energy_drift_max_J"] == own.energy_drift_max_J
            assert c["numbers"]["t_reached_s"] == own.t_reached_s


@pytest.mark.sampled(0)
def test_files_for_print_hold_their_fonts_and_do_not_change(whole, tmp_path):
    """TrueType in the PDF, paths in the SVG; the same records give the same bytes."""
    folder, _ = whole
    first = one(folder, "fig05", SUFFIXES)
    content = {n: (folder / "paper" / n).read_bytes() for n in first.files}
    assert sorted(content) == ["fig05.pdf", "fig05.png", "fig05.svg"]
    assert b"/FontFile2" in content["fig05.pdf"] and b"/Type3" not in content["fig05.pdf"]
    assert b"<text" not in content["fig05.svg"]
    one(folder, "fig05", SUFFIXES)
    assert {n: (folder / "paper" / n).read_bytes() for n in first.files} == content


def test_missing_runs_are_named_on_figure_and_caption(tmp_path):
    """Never dropped in silence, not even when nothing is left."""
    fill(tmp_path, "fig05", "fig12", without=("ndf_index1",))
    figure, _ = drawn(tmp_path, "fig05")
    assert "DAE-SE (ndf_index1), rtol = 0.001: not in these results" in legend(figure)
    note = " ".join(one(tmp_path, "fig05").note)
    assert "Not in these results: spherical_pendulum ndf_index1[accelerations=eliminated," in note
    sketch, _ = drawn(tmp_path, "fig04")
    assert "not in these results" in " ".join(t.get_text() for t in sketch.axes[0].texts).replace("\n", " ")
    for path in (tmp_path / "runs").iterdir():
        path.unlink()
    empty, _ = drawn(tmp_path, "fig12")
    assert legend(empty).count("not in these results") == 2


def test_a_run_that_stopped_is_starred_where_it_stopped(tmp_path):
    """In every panel that reaches so far, and in words in legend and caption."""
    stop = {"status": "singular", "t_reached_s": 1.5, "message": "the matrix is singular"}
    fill(tmp_path, "fig06", ida_index1=stop)
    figure, _ = drawn(tmp_path, "fig06")
    stars = [line for ax in figure.axes for line in ax.get_lines() if line.get_marker() == "*"]
    assert len(stars) == 4 and all(s.get_xdata()[0] == pytest.approx(1.5) for s in stars)
    assert "★ singular at 1.5 s" in legend(figure)
    assert "DAE-FI, rtol = 0.001: stops at 1.5 s, singular (the matrix is singular)." in one(tmp_path, "fig06").note


def test_runs_of_a_solver_are_named_by_what_differs(whole):
    """Both choices of c_R; the printed and the recommended settings of the grid."""
    names = {f"{k.role}, {k.settings}" for name in ("fig05", "fig12") for k in drawn(whole[0], name)[1]}
    printed = "ODE-GC (as printed), dt = 0.01 s, c_R = "
    assert {f"{printed}a/(a·a)", f"{printed}(e_R, 0)", "ODE-GC (AL, symmetric), dt = 0.01 s, recommended"} < names
    assert any(n.startswith("ODE-GC (AL, ") and n.endswith(", as printed") for n in names)
    assert "DAE-FI, rtol = 0.001" in names


def test_the_loose_tolerance_is_left_out_where_the_paper_does(whole):
    """Fig. 9b and c show the smaller tolerance alone."""
    _, own = drawn(whole[0], "fig09")
    panel = next(p for p in BY_NAME["fig09"].panels() if p.tightest)
    assert {k.asked.control.rtol for k in own} == {None, 1e-3, 1e-6}
    assert lines.select_lines(panel, own) == [k for k in own if k.asked.control.rtol != 1e-3]


def test_a_solver_has_its_colour_and_its_settings_dashes(whole):
    """Colours of the palette; the finest tolerance is solid, as in the report."""
    figure, own = drawn(whole[0], "fig02")
    fi = sorted((k.asked.control.rtol, k.dash) for k in own if k.asked.solver == "ida_index1")
    assert [dash for _, dash in fi] == [0, 1, 2]
    (legend,) = figure.legends
    colours = {h.get_color() for h in legend.legend_handles}
    assert colours == {look.colour for look in spec.choose_styles(["ida_index1", "gc_weak_form"]).values()}


def test_a_damaged_series_is_named(tmp_path):
    """The record is there, its file is not what was recorded."""
    records = fill(tmp_path, "fig12")
    run = next(c for c, r in records.items() if '"loop"' in r.solver_options)
    (tmp_path / "series" / f"{run}.npz").write_bytes(b"not a file of numbers")
    _, own = drawn(tmp_path, "fig12")
    assert own[0].words.endswith("its series cannot be read")


def test_one_figure_made_again_keeps_the_captions_of_the_others(tmp_path):
    fill(tmp_path, "fig08", "fig10")
    build.draw_figures(tmp_path, ["fig10"], suite(), suffixes=("png",))
    build.draw_figures(tmp_path, ["fig08"], suite(), suffixes=("png",))
    assert [c.name for c in captions.read_captions(tmp_path)] == ["fig08", "fig10"]


def test_a_run_made_again_takes_the_place_of_the_old_one():
    """Two states of the code in one folder: the later counts; other settings never do."""
    figure = BY_NAME["fig08"]
    old = make_numbered_record(asked("fig08")[0])
    new = dataclasses.replace(old, run_id="f" * 16, finished="2026-02-02")
    assert lines.match_runs(figure.picks, suite(), [StoredRun(new), StoredRun(old)])[0].run.record is new
    other = dataclasses.replace(old, settings_id="another")
    assert lines.match_runs(figure.picks, suite(), [StoredRun(other)])[0].run is None


def test_claims_of_a_figure_are_in_its_caption(tmp_path):
    """The published verdicts, marked so, until these results are judged; under the printed settings alone."""
    fill(tmp_path, "fig09", "fig09-recommended")
    published = read_claims(PUBLISHED)
    before = one(tmp_path, "fig09")
    assert before.claims_published
    assert [c.id for c in before.claims] == [c.id for c in published if 9 in c.figure]
    assert one(tmp_path, "fig09-recommended").claims == ()
    judged = next(c for c in published if c.id == "9-energy-drop")
    refuted = ClaimFinding(ClaimVerdict.NOT_REPRODUCED, 0, 2, 2)
    own = (replace(judged, paper=refuted, beyond=None),)
    write_judgements(ConfinedPath(tmp_path) / FOLDER, {"claims": own}, {"claims": CodeDigests({}, {}, "", "", "")})
    (claim,) = one(tmp_path, "fig09").claims
    assert (claim.paper, claim.beyond) == (("not reproduced", "for none of 2 tried"), ("", ""))
    assert claim.tests[0][1] == format_band(judged.tests[0])
    (tmp_path / FOLDER / "claims.json").write_text("[{", encoding="utf-8")
    assert one(tmp_path, "fig09").claims_published


def test_command_writes_one_figure_or_names_all(whole, capsys):
    folder = str(whole[0])
    assert main(["figures", folder, "--paper", "--only", "fig08"]) == 0
    assert "fig08" in capsys.readouterr().out and (whole[0] / "paper" / "fig08.pdf").exists()
    assert main(["figures", folder, "--paper", "--only", "fig13"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: no figure 'fig13'") and said.count("\n") == 1


def test_the_page_shows_figures_claims_and_runs(tmp_path):
    """Also of a run that these results do not hold."""
    fill(tmp_path, "fig11", without=("ndf_index1",))
    build.draw_figures(tmp_path, ["fig11"], suite(), suffixes=("svg",))
    html = (site.build_report(tmp_path).parent / "paper.html").read_text(encoding="utf-8")
    assert "Fig. 11" in html and "not run" in html
    assert "These results are not judged" in html and "DAE-SE gets to 5 s" in html and "not reproduced" in html
