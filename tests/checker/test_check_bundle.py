"""The independent checker agrees with honest bundles, finds planted changes and refuses hostile files in one line."""

import ast
import importlib.util
import io
import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.tests.attacks.bundles import write
from mbsbench.tests.harness.lab.ladder.forgeries.bundles import change_states

PROGRAM = Path(__file__).resolve().parents[2] / "checker" / "check_bundle.py"
SPEC = importlib.util.spec_from_file_location("check_bundle", PROGRAM)
checker = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(checker)

SUITE = """name = "checked"
[[runs]]
problem = "heavy_top"
parameters = { t_end = 0.2 }
solver = ["gc_weak_form", "rk45_strong_form"]
dt = [0.002, 0.02]
rtol = 1e-6
[[runs]]
problem = "torque_free_body"
parameters = { t_end = 0.5 }
solver = "rk45_strong_form"
rtol = [1e-4, 1e-6]
"""


@pytest.fixture(scope="module")
def bundles(tmp_path_factory):
    """A thinned and a lossless bundle of five short runs."""
    folder = tmp_path_factory.mktemp("checked")
    (folder / "suite.toml").write_text(SUITE)
    results = str(folder / "results")
    assert main(["run", str(folder / "suite.toml"), "--out", results, "--lossless", "--jobs", "1"]) == 0
    for name, options in (("thin", []), ("lossless", ["--lossless"])):
        assert main(["bundle", results, "-o", str(folder / f"{name}.zip"), *options]) == 0
    return {name: folder / f"{name}.zip" for name in ("thin", "lossless")}


def read(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def check(path):
    """The findings; a file that is none ends in an exception."""
    with np.errstate(all="ignore"):
        return checker.Report(path).findings


def change_matrix(files, name, key, function):
    """Replace a quantity of all states in a matrix by a function of it."""
    values = np.load(io.BytesIO(files[name]))
    change_states(values, key, function)
    stream = io.BytesIO()
    np.save(stream, values)
    files[name] = stream.getvalue()


def change_record(files, key, function):
    records = json.loads(files["records.json"])
    records[0][key] = function(records[0][key])
    files["records.json"] = json.dumps(records).encode()


def change_state(files, key, function):
    run = json.loads(files["runs.json"])[0]
    change_matrix(files, f"runs/{run['run_id']}.npy", key, function)


def change_problem(files, function):
    name = f"problems/{json.loads(files['runs.json'])[0]['problem']}.json"
    problem = json.loads(files[name])
    function(problem)
    files[name] = json.dumps(problem).encode()


def change_reference(files, quantity="v", function=lambda v: v + 1e-3):
    key = json.loads(files["runs.json"])[0]["problem"]
    change_matrix(files, f"references/{key}.npy", quantity, function)


REFERENCES = {  # of every quantity that exact states have
    "t": lambda t: 1.01 * t,
    "r": lambda r: r + 1e-6,
    "R": lambda R: R * (1 + 1e-6),
    "v": lambda v: v + 1e-6,
    "Omega": lambda Omega: 1.00001 * Omega,
    "stated": lambda stated: stated + 1e-6,
}
CELLS = {  # of every column of the table
    "runs": lambda n: n + 1,
    "success": lambda n: n - 1,
    "inaccurate": lambda n: n + 1,
    "wrong": lambda n: n + 1,
    "least_motion_error_m": lambda x: 0.5 * float(x),
    "least_cpu_s": lambda x: 0.5 if x == "inf" else "inf",
    "problem": lambda name: "chain",
    "problem_parameters": lambda text: "{}",
    "solver": lambda name: "rattle",
}


PLANTED = {
    "a number": lambda files: change_record(files, "energy_drift_max_J", lambda x: x / 2 + 1e-6),
    "the status": lambda files: change_record(files, "status", lambda x: "wrong" if x != "wrong" else "success"),
    "velocities": lambda files: change_state(files, "v", lambda v: 1.001 * v + 1e-6),
    "poses": lambda files: change_state(files, "r", lambda r: r + 1e-6),
    "rotations": lambda files: change_state(files, "R", lambda R: R * (1 + 1e-6)),
    "a mass": lambda files: change_problem(
        files, lambda p: p["numbers"]["mass"].append(1.01 * p["numbers"]["mass"].pop())
    ),
    "the reference": change_reference,
}


def test_the_checker_is_one_file_that_imports_numpy_alone():
    """Beside the standard library: whoever doubts mbsbench can read it through, and nothing of mbsbench answers."""
    text = PROGRAM.read_text(encoding="utf-8")
    found = set()
    for node in ast.walk(ast.parse(text)):
        assert not (isinstance(node, ast.Name) and node.id in {"__import__", "eval", "compile"})
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add("" if node.level else node.module.partition(".")[0])
    assert {p.name for p in PROGRAM.parent.glob("*.py")} == {PROGRAM.name}
    assert found - set(sys.stdlib_module_names) == {"numpy"} and "importlib" not in found


def test_its_page_says_what_each_part_costs():
    """Who audits the file plans by that table; a function that no part names would be read by nobody."""
    size, owner = {}, {}
    for node in ast.parse(PROGRAM.read_text(encoding="utf-8")).body:
        for function in node.body if isinstance(node, ast.ClassDef) else [node]:
            if isinstance(function, ast.FunctionDef):
                name = f"{node.name}.__init__" if function.name == "__init__" else function.name
                size[name], owner[name] = function.end_lineno - function.lineno + 1, node.name
    rows = re.findall(r"^\| [^|]+ \| ((?:`\w+` ?)+)\| (\d+) \|$", PROGRAM.with_name("README.md").read_text(), re.M)
    named = {name for words, _ in rows for name in re.findall(r"\w+", words)}
    left = dict(size)
    for words, lines in rows:
        names = set(re.findall(r"\w+", words))
        own = [name for name in left if name in names or (name not in named and owner[name] in names)]
        assert sum(left.pop(name) for name in own) == int(lines), f"{words}: {own}"
    assert not left


@pytest.mark.parametrize("kind", ["thin", "lossless"])
def test_honest_bundles_agree(bundles, kind):
    with np.errstate(all="ignore"):
        report = checker.Report(bundles[kind])
    assert report.findings == []
    assert report.runs == 5 and report.numbers > 100


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", ["thin", "lossless"])
@pytest.mark.parametrize("change", PLANTED)
def test_a_planted_change_is_found(bundles, tmp_path, change, kind):
    files = read(bundles[kind])
    assert check(write(tmp_path / "same.zip", files)) == []
    PLANTED[change](files)
    assert check(write(tmp_path / "b.zip", files))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", ["inertia", "gravity", "start_Omega", "joint_s_i"])
def test_a_proved_motion_has_its_closed_form(bundles, tmp_path, number):
    """Elliptic integrals give the nutation of the top that theta functions gave; of other numbers they do not."""
    files = read(bundles["thin"])
    name = next(n for n in files if n.startswith("problems/") and b'"heavy_top"' in files[n])
    for factor, agree in ((1.0, True), (1.01, False)):
        plain = json.loads(files[name])
        plain["numbers"][number] = (factor * np.array(plain["numbers"][number])).tolist()
        found = check(write(tmp_path / "b.zip", files | {name: json.dumps(plain).encode()}))
        assert agree == (not any("closed form" in line for line in found))


@pytest.mark.parametrize("change", ["later", "another phase"])
def test_the_closed_form_and_the_equations_find_another_motion_of_the_same_top(bundles, tmp_path, change):
    """It keeps every other law but the pace, which only tells where two states are nearer in time than others."""
    files = read(bundles["lossless"])
    name = next(n[9:-5] for n in files if n.startswith("problems/") and b'"heavy_top"' in files[n])
    values = np.load(io.BytesIO(files[f"references/{name}.npy"]))
    values[1:] = np.roll(values[1:], 1 if change == "later" else 7, axis=1)
    stream = io.BytesIO()
    np.save(stream, values[:, 8:])
    found = check(write(tmp_path / "b.zip", files | {f"references/{name}.npy": stream.getvalue()}))
    by_law = {line[18:56].strip() for line in found if "reference" in line[18:29]}
    assert by_law - {"reference: pace"} == {"reference: closed form / allowed", "reference: equations"}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", ["thin", "lossless"])
@pytest.mark.parametrize("quantity", REFERENCES)
def test_a_forged_number_in_a_reference_is_found(bundles, tmp_path, quantity, kind):
    files = read(bundles[kind])
    change_reference(files, quantity, REFERENCES[quantity])
    assert check(write(tmp_path / "b.zip", files))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("column", CELLS)
def test_a_forged_number_in_the_table_is_found(bundles, tmp_path, column):
    """In each row; a row of another name makes it the table of other records."""
    for row in range(len(json.loads(read(bundles["thin"])["table.json"]))):
        files = read(bundles["thin"])
        table = json.loads(files["table.json"])
        table[row][column] = CELLS[column](table[row][column])
        files["table.json"] = json.dumps(table).encode()
        if column in {"problem", "problem_parameters", "solver"}:
            with pytest.raises(ValueError, match="other rows"):
                check(write(tmp_path / "b.zip", files))
        else:
            (found,) = check(write(tmp_path / "b.zip", files))
            assert column in found


@pytest.mark.parametrize("column", ["judged_to_s", "gap_share_max", "motion_error_max_m", "phi_max", "energy_scale_J"])
def test_a_number_that_is_none_hides_nothing(bundles, tmp_path, column):
    """Also where the bundle keeps no state of the largest value, which then is no bound."""
    files = read(bundles["thin"])
    records, runs = json.loads(files["records.json"]), json.loads(files["runs.json"])
    place = next(k for k, record in enumerate(records) if record["claimed"] == "success")
    assert column in records[place]
    records[place][column] = "nan"
    run = next(run for run in runs if run["run_id"] == records[place]["run_id"])
    run["peaks_s"].pop(column, None)
    files |= {"records.json": json.dumps(records).encode(), "runs.json": json.dumps(runs).encode()}
    assert any(column in line for line in check(write(tmp_path / "b.zip", files)))


def test_a_removed_file_or_a_wrong_digest_is_refused(bundles, tmp_path):
    files = read(bundles["thin"])
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        for name, raw in files.items():
            archive.writestr(name, raw + b" " if name == "suite.toml" else raw)
    with pytest.raises(ValueError, match=r"suite.toml'\] differs"):
        check(tmp_path / "b.zip")
    del files[next(name for name in files if name.startswith("problems/"))]
    with pytest.raises(KeyError):
        check(write(tmp_path / "b.zip", files))


def pickle_of_objects():
    stream = io.BytesIO()
    np.save(stream, np.array([{}], dtype=object), allow_pickle=True)
    return stream.getvalue()


HEADER = b"\x93NUMPY\x01\x00v\x00"
HUGE = HEADER + b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000,), }".ljust(117) + b"\n"
HOSTILE = {
    "deep": {"records.json": b"[" * 1_000_000},
    "huge": {"records.json": b"[" + b"[]," * 4_000_000 + b"[]]"},
    "parent": {"runs/../../x.npy": b""},
    "extra": {"runs/x.exe": b""},
    "bomb": {"suite.toml": b"\0" * 20_000_000, "records.json": b" " * 20_000_000},
    "no list": {"runs.json": b"{}"},
    "repeated key": {"bundle.json": b'{"format": 1, "format": 2}'},
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", [*HOSTILE, "pickle", "shape", "times", "text", "nan", "duplicate", "link"])
def test_hostile_files_end_in_one_line(bundles, tmp_path, name):
    files, path = read(bundles["thin"]), tmp_path / "b.zip"
    run = json.loads(files["runs.json"])[0]
    vector = f"runs/{run['run_id']}.npy"
    if name in HOSTILE:
        files |= HOSTILE[name]
    elif name in {"pickle", "shape"}:
        files[vector] = pickle_of_objects() if name == "pickle" else HUGE
    elif name == "times":
        change_matrix(files, vector, "t", lambda t: t[::-1])
    elif name == "nan":
        change_problem(files, lambda p: p["numbers"].update(mass=[float("nan")]))
    write(path, files)
    if name == "text":
        path.write_bytes(b"PK\5\6" * 30)
    elif name in {"duplicate", "link"}:
        with zipfile.ZipFile(path, "a") as archive:
            entry = zipfile.ZipInfo("suite.toml" if name == "duplicate" else "runs/link.npy")
            entry.external_attr = (0o120777 if name == "link" else 0o100644) << 16
            archive.writestr(entry, "x")
    ended = subprocess.run([sys.executable, PROGRAM, path], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr, ended.stdout.count("\n")) == (2, "", 1), ended
