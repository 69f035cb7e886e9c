"""The command: files in the run folder, a table, changes, exit codes; and verdicts that do not depend on the run."""

import dataclasses
import json
import math
from functools import partial

import numpy as np
import pytest
from msgspec.structs import replace

from mbsbench.cli import judge as command
from mbsbench.cli.__main__ import main
from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.catalogue.suites.suite import Suite
from mbsbench.harness.judge.referee import judge as judging
from mbsbench.harness.judge.referee.claims.frame import read_dimensions, select_runs
from mbsbench.harness.judge.referee.claims.judging import judge_claims
from mbsbench.harness.judge.referee.claims.register import read_register
from mbsbench.harness.judge.referee.registers import FIELD, PAPER
from mbsbench.harness.mechanics.types import Law, Reason
from mbsbench.harness.results import store
from mbsbench.harness.results.envelopes import Envelope
from mbsbench.harness.results.judgements import files
from mbsbench.harness.results.records import format_reasons
from mbsbench.harness.results.series import EnvelopedSeries
from mbsbench.harness.run.runner import Request, run_suite
from mbsbench.tests.factories import Silent, make_record, make_series, parse_specs

from ....reports.pages.synthetic import ORDER
from .claiming import HEAD, MAP, SUITE, TEST, claim, judged

RUNS = parse_specs(SUITE)


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A run folder of made-up records and a register of one claim, judged on the suite of the tests alone."""
    monkeypatch.setattr(judging, "list_tried_runs", lambda *_: RUNS)
    monkeypatch.setattr(judging, "OTHERS", ())
    monkeypatch.setattr(judging, "list_published_runs", lambda place=PAPER: RUNS if place.name == PAPER.name else ())
    register = tmp_path / "claims.toml"
    register.write_text(MAP + HEAD + TEST)

    def write(phi_max, specs=RUNS):
        folder = store.create_folder(tmp_path / "run")
        for x in specs:
            store.write_record(folder, make_record(x, phi_max=phi_max, series=""))
        return folder

    monkeypatch.setattr(command, "PUBLISHED", ConfinedPath(tmp_path / "published"))
    monkeypatch.setattr(command, "find_older_runs", lambda *_: ())  # records made up here have no code
    monkeypatch.setattr(command, "check_not_installed", lambda *_: None)

    def call(*arguments):
        return main(["judge", str(tmp_path / "run"), "--claims", str(register), *arguments])

    return write, call, register


def written(folder):
    """The contents of ``claims.json`` of a judged folder."""
    return json.loads((folder / "judgement" / "claims.json").read_text())


def test_judging_writes_files_and_publishing_compares(made, tmp_path, capsys):
    """Nothing published: 0. Published: 0 for the same verdicts, whatever they are, 1 for a changed one, named."""
    write, call, _ = made
    folder = write(0.5)
    assert call() == 0
    assert "nothing is published yet" in capsys.readouterr().out
    assert written(folder)["claims"][0]["beyond"]["verdict"] == "reproduced"
    assert call("--publish") == 0 and (tmp_path / "published" / "claims.json").exists()
    capsys.readouterr()
    assert call() == 0
    assert "as published" in capsys.readouterr().out
    write(1.5)
    assert call() == 1
    assert "changed: c: beyond reproduced -> beyond not reproduced" in capsys.readouterr().out
    assert call("--publish") == 0 and call() == 0


@pytest.mark.parametrize(("equal", "code"), [(True, 0), (False, 2)])
def test_runs_of_earlier_code_are_judged_where_they_are_carried_over(made, monkeypatch, capsys, equal, code):
    """Their bits are those of this code; of any other code they are made anew."""
    write, call, _ = made
    write(0.5)
    monkeypatch.setattr(command, "find_older_runs", lambda records, _: tuple(records))
    monkeypatch.setattr(command, "is_current_or_carried", lambda *_: equal)
    assert call() == code
    assert ("are older than the code of" in capsys.readouterr().err) is not equal


def test_a_run_that_a_resumed_folder_holds_twice_counts_once(made, tmp_path):
    """Of two codes the later counts, in every judgement; a later crash does not replace a success."""
    _, _, register = made
    folder = store.create_folder(tmp_path / "run")

    def resumed(code: str, specs=RUNS, **columns):
        for x in specs:
            own = make_record(x, run_id=code + x.settings_id[1:16], finished=code, series="", **columns)
            store.write_record(folder, own)
        return judging.judge_results(folder, (dataclasses.replace(PAPER, path=register), FIELD))

    wrong = {"status": "wrong", "claimed": "success", "wrong_because": format_reasons([Reason(Law.ENERGY, 2.0, 1.0)])}
    for code in "12":
        assert len(resumed(code, phi_max=1.5, **wrong)["wrong"]) == len(RUNS)
    found = resumed("3", RUNS[1:], phi_max=0.5, claimed="success")
    assert [w.settings_id for w in found["wrong"]] == [RUNS[0].settings_id]
    found = resumed("4", phi_max=0.5, claimed="success")
    assert not found["wrong"] and found["claims"][0].verdict == "reproduced"
    found = resumed("5", status="crashed", phi_max=1.5)
    assert not found["wrong"] and found["claims"][0].verdict == "reproduced"


FIELD_CLAIMS = len(read_register(FIELD.path).claims)
LACKS = (
    "1 of 1 claims lack runs and nothing was compared with the published verdicts; make them: "
    "mbsbench run referee --resume\n"
    f"{FIELD_CLAIMS} of {FIELD_CLAIMS} claims of textbooks and manuals lack runs and nothing was compared with the "
    "published verdicts; make them: mbsbench run field --resume\n"
)  # a line a register, however many claims


def test_results_that_lack_runs_are_judged_on_request_alone_and_never_published(made, tmp_path, capsys):
    """Else the verdicts of another suite's results would differ from the published ones, and could replace them."""
    write, call, _ = made
    folder = write(0.5, RUNS[1:])
    for arguments in ((), ("--publish",), ("--publish", "--partial")):
        assert call(*arguments) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and "lacks 1 of 1" in said and RUNS[0].case in said
        assert ("--partial" in said) is not bool(arguments)
    assert not (folder / "judgement").exists() and not (tmp_path / "published").exists()
    write(0.5)
    assert call("--publish") == 0
    for path in (folder / "runs").iterdir():
        path.unlink()
    write(0.5, RUNS[1:])
    capsys.readouterr()
    assert call("--partial") == 0
    said = capsys.readouterr().out
    assert said == LACKS
    assert written(folder)["claims"][0]["beyond"]["verdict"] == "cannot be told"


def test_claims_that_no_run_touches_are_not_shown(made, capsys):
    """A newcomer's results hear nothing of the paper's claims but that there are some."""
    write, call, _ = made
    write(0.5, ())
    assert call("--partial") == 0
    assert capsys.readouterr().out == LACKS


def test_each_register_is_judged_and_published_where_its_runs_are(made, tmp_path, monkeypatch, capsys):
    """Results of the field's runs alone: its verdicts are published, and compared, and the paper's stay untouched."""
    write, call, register = made
    field = dataclasses.replace(FIELD, path=tmp_path / "field.toml")
    field.path.write_text(
        register.read_text().replace("spherical_pendulum", "heavy_top").replace('id = "c"', 'id = "f"')
    )
    own = {"paper": RUNS, "field": parse_specs(SUITE.replace("spherical_pendulum", "heavy_top"))}
    monkeypatch.setattr(judging, "list_tried_runs", lambda place=PAPER: own[place.name])
    monkeypatch.setattr(judging, "list_published_runs", lambda place=PAPER: own[place.name])
    monkeypatch.setattr(command, "FIELD", field)
    folder = write(0.5, own["field"][:-2])
    for arguments, lacks in ((), "lacks 12 of 12"), (("--publish",), "lacks 13 of 13"):
        assert call(*arguments) == 2 and lacks in capsys.readouterr().err
    write(0.5, own["field"])
    assert call() == 0
    said = capsys.readouterr().out
    assert said.startswith(LACKS.splitlines()[0]) and "claims of textbooks and manuals: 1 reproduced, 0 repr" in said
    assert json.loads((folder / "judgement" / "field.json").read_text())["claims"][0]["register"] == "field"
    assert call("--publish") == 0
    assert {p.name for p in (tmp_path / "published").iterdir()} == {"field.json"}
    assert call() == 0 and "as published" in capsys.readouterr().out
    write(1.5, own["field"])
    assert call() == 1
    assert "changed: f: beyond reproduced -> beyond not reproduced" in capsys.readouterr().out


def test_published_verdicts_that_are_not_there_are_a_wrong_call(made, tmp_path, capsys):
    """Named, they are what somebody wants to compare with: nothing compared is no success."""
    write, call, _ = made
    write(0.5)
    assert call("--published", str(tmp_path / "nowhere")) == 2
    assert "holds no verdicts" in capsys.readouterr().err
    assert call("--published", str(tmp_path / "new"), "--publish") == 0 == call("--published", str(tmp_path / "new"))


def test_json_is_the_claims_and_the_orders(made, capsys, monkeypatch):
    """The claims as in their file, and each ladder of fixed steps; an order below the declared one is no exit code."""
    write, call, _ = made
    folder = write(0.5)
    low = replace(ORDER, quantity="position", verdict="below declared", order=1.0)
    monkeypatch.setattr(judging, "OTHERS", (("certificates", lambda *_: (low, replace(low, quantity="energy"))),))
    assert call("--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert {k: said[k] for k in ("schema", "code", "claims", "commands")} == written(folder)
    assert said["schema"] == 3
    assert [(o["quantity"], o["verdict"]) for o in said["orders"]] == [("position", "below declared")]


def test_wrong_calls_are_one_line(made, capsys, tmp_path):
    """No run, a bad register, published results that cannot be read: 2 and a line."""
    write, call, register = made
    assert main(["judge", "nowhere"]) == 2
    write(0.5)
    (tmp_path / "published").mkdir()
    (tmp_path / "published" / "claims.json").write_text("{")
    assert call() == 2
    register.write_text("[[claims]]\nid = 'x'")
    assert call() == 2
    errors = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("judging")]
    assert len(errors) == 3 and all(line.startswith("error: ") for line in errors)


def test_the_tally_is_that_of_results():
    """That a problem is presented as in the paper says nothing about a solver."""
    rows = [judged("a", "not reproduced")] * 2 + [judged("b", "reproduced", "presentation")]
    words = "at the paper's settings: 0 reproduced, 0 reproduced if, 0 not reproduced, 0 cannot be told\n"
    words += "beyond them: 0 reproduced, 0 reproduced if, 2 not reproduced, 0 cannot be told"
    assert command.count_verdicts(rows) == words + "\nchecks of the set-up: 1 of 1 reproduced"
    assert command.count_verdicts(rows[:2]) == words
    words = "claims of textbooks and manuals: 0 reproduced, 0 reproduced if, 2 not reproduced, 0 cannot be told"
    assert command.count_verdicts(rows[:2], FIELD) == words


def test_claims_that_come_and_go_are_changes():
    before = [judged("a", "reproduced"), judged("b", "not reproduced")]
    after = [judged("b", "reproduced if"), judged("c", "reproduced")]
    assert judging.find_changes(before, after) == [
        ("b", "beyond not reproduced", "beyond reproduced if"),
        ("c", "", "beyond reproduced"),
        ("a", "beyond reproduced", ""),
    ]


def test_texts_of_a_register_are_not_markup(made, capsys):
    """Words in brackets are words, in the table too."""
    write, call, register = made
    register.write_text((MAP + HEAD + TEST).replace('id = "c"', 'id = "[bold]c[/]"'))
    write(0.5)
    assert call() == 0
    assert "[bold]c[/]" in capsys.readouterr().out
    assert command.STYLE.keys() == {"reproduced", "reproduced if", "not reproduced", "cannot be told"}


CHEAP = (  # claims whose runs take half a minute or so: most problems, most verdicts
    "1-one-step",
    "1-any-tolerance",
    "5-gc-near-tolerance",
    "5-ode45-smallest",
    "7-start",
    "11-gc-coincident",
    "11-ode45-coincident",
    "11-ode45-step-decrease",
    "beyond-redundant",
    "9-adams",
    "4-nonholonomic",
    "6-rheonomic",
    "general-no-scaling",
)


def maps_of(claim):
    """Where it is tried, what it is set against, and what stands beside it."""
    return [m for m in (claim.map, claim.against, claim.control) if m]


@pytest.fixture(scope="module")
def twice(tmp_path_factory):
    """The verdicts on some claims from their runs run with one and with two processes."""
    register, runs_tried = read_register(), judging.list_tried_runs()
    few = dataclasses.replace(register, claims=tuple(c for c in register.claims if c.id in CHEAP))
    places = [read_dimensions(c) for c in runs_tried]
    specs = {p.spec.settings_id: p.spec for c in few.claims for m in maps_of(c) for p in select_runs(places, m.over)}
    part = Suite("part", "", tuple(specs.values()), "")
    out = []
    for jobs in (1, 2):
        folder = tmp_path_factory.mktemp(f"jobs{jobs}")
        loaded = run_suite(Request(part, folder, jobs), Silent())
        out.append(judge_claims(few, runs_tried, loaded.records, partial(store.read_run_series, folder)))
    return out


@pytest.mark.slow
def test_verdicts_are_the_same_with_one_and_two_processes(twice):
    """Two runs, each of its own processes: the same judgement, byte for byte."""
    first, second = map(files.format_judgement, twice)
    assert first == second
    assert {c.id for c in twice[0]} == set(CHEAP)
    assert len({c.verdict for c in twice[0]}) > 2


@pytest.mark.slow
def test_verdicts_are_those_published(twice):
    """A verdict that changes against results/published is a change of the result, to be published or mended."""
    published = files.read_claims(files.PUBLISHED)
    if published is None:
        pytest.skip("nothing is published: mbsbench judge --publish")
    known = {c.id: c.verdicts for c in published}
    assert {c.id: c.verdicts for c in twice[0]} == {c: known.get(c) for c in CHEAP}


def test_ladders_that_do_not_show_the_declared_order_are_printed(capsys, monkeypatch):
    """With the order and the reason; the certified ones are counted."""
    monkeypatch.setenv("COLUMNS", "200")
    low = replace(
        ORDER,
        case="beta",
        verdict="below declared",
        order=1.04,
        low=0.98,
        high=1.08,
        fit="power",
        dt=(0.1,),
        used=(True,),
    )
    no = replace(ORDER, case="gamma", verdict="refused", order=math.nan, status="refused", message="no springs")
    command.show_orders([replace(ORDER, verdict="certified"), low, no])
    said = capsys.readouterr().out
    assert "orders: 1 certified, 1 below declared, 1 refused" in said
    (row,) = (line for line in said.splitlines() if "beta" in line)
    assert "1.04" in row and "below declared" in row
    assert "refused: no springs" in said and "alpha" not in said


def test_a_series_kept_as_an_envelope_is_refused_with_the_run_that_lacks_it():
    """A claim that is new asks for every step of runs that kept bounds alone: the message says of which."""
    bounds = Envelope(0.0, 10.0, np.zeros((2, 4), dtype=int))
    kept = dataclasses.replace(make_series([0.0, 10.0]), envelopes={"phi_norm": bounds})
    test = 'map = "m"\ntests = [{ metric = "largest", series = "phi_norm", at_most = 1.0, unit = "m" }]\n'
    with pytest.raises(EnvelopedSeries, match=r"spherical_pendulum.* test 'largest' .*phi_norm is stored"):
        claim(test, of=lambda r: kept)
