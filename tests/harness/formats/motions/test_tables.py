"""How other tools write tables: one exact motion in each form is a success, or is refused in its own terms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from mbsbench import RigidBody, State, assemble
from mbsbench.harness.base.files import FileError
from mbsbench.harness.formats.motions.conventions import Reading, find_factor
from mbsbench.harness.formats.motions.judge import FileSettings, judge_file
from mbsbench.harness.mechanics.types import Problem

J, W0 = np.array([1.0, 2.0, 2.5]), np.array([0.3, 1.5, 0.2])
HEAD = "t,x,y,z,qw,qx,qy,qz"


def tumbling(x: float = 0.0) -> Problem:
    """A free body that tumbles at ``x``."""
    start = State(np.array([[x, 0.0, 0.0]]), np.eye(3)[None], np.zeros((1, 3)), W0[None])
    system = assemble([RigidBody(1.0, np.diag(J), "body")])
    return Problem("tumbling", system, start, 1.0, 5e-3, section="", source="Euler's equations")


def rates(_, y):
    """Euler's equations and those of the quaternion, of which nothing here is ours."""
    q0, q, w = y[0], y[1:4], y[4:]
    return np.concatenate(([-0.5 * q @ w], 0.5 * (q0 * w + np.cross(q, w)), -np.cross(w, J * w) / J))


T = np.linspace(0.0, 1.0, 201)
Y = solve_ivp(rates, (0.0, 1.0), [1.0, 0.0, 0.0, 0.0, *W0], method="DOP853", rtol=1e-13, atol=1e-15, t_eval=T).y.T
PLAIN = np.column_stack((T, np.zeros((201, 3)), Y[:, :4]))
R = Rotation.from_quat(Y[:, :4], scalar_first=True)


def rows(a=PLAIN, fmt="%.12g", sep=","):
    return [sep.join(fmt % v for v in r) for r in a]


def text(head, lines, encoding="utf-8"):
    return ("\n".join(([head] if head else []) + lines) + "\n").encode(encoding)


def judge(folder, name, content, problem=None, **reading):
    path = folder / name
    path.write_bytes(content)
    return judge_file(problem or tumbling(), path, FileSettings("other", Reading(**reading)), None)


def quote(line):
    return '"' + line.replace(",", '","') + '"'


DEGREES = rows(np.column_stack((PLAIN, np.degrees(Y[:, 4:]))))
STO = "Positions\nversion=1\nnRows=201\nnColumns=8\ninDegrees=no\nendheader\n" + HEAD.replace(",", "\t")


def mm_and_ms():
    a = PLAIN * np.array([1e3, 1e3, 1e3, 1e3, 1, 1, 1, 1])
    return text(HEAD.replace("t,x,y,z", "time [ms],x [mm],y [mm],z [mm]"), rows(a))


def in_order(names, sequence):
    return text(f"t,x,y,z,{names}", rows(np.column_stack((PLAIN[:, :4], R.as_euler(sequence)))))


SAME = {  # file, content, reading, words of a note
    "plain.csv": (text(HEAD, rows()), {}, ""),
    "units.csv": (mm_and_ms(), {}, ""),
    "units_row.csv": (text(HEAD + "\ns,m,m,m,-,-,-,-", rows()), {}, ""),
    "units_row.txt": (text(HEAD.replace(",", " ") + "\n[s] [mm] [mm] [mm] [-] [-] [-] [-]", rows(sep=" ")), {}, ""),
    "title.csv": (text("Results of model 1\n" + HEAD, rows()), {}, "not read: the title 'Results of model 1'"),
    "trailing_comma.csv": (text(HEAD + ",", [x + "," for x in rows()]), {}, ""),
    "quoted.csv": (text(quote(HEAD), [quote(x) for x in rows()]), {}, ""),
    "fortran.dat": (text(HEAD, [x.replace("e", "D") for x in rows(fmt="%.12e")]), {}, ""),
    "comma.tsv": (text(HEAD.replace(",", "\t"), [x.replace(".", ",") for x in rows(sep="\t")]), {}, ""),
    "comma.txt": (text(HEAD.replace(",", " "), [x.replace(".", ",") for x in rows(sep=" ")]), {}, ""),
    "cp1252.csv": (
        text(HEAD + ",wx (°/s),wy (°/s),wz (°/s)", DEGREES, "cp1252"),
        {},
        "",
    ),
    "utf16.csv": (text(HEAD, rows(), "utf-16"), {}, ""),
    "opensim.sto": (
        text(STO, rows(sep="\t")),
        {},
        "",
    ),
    "degrees.mot": (
        text(
            "Coordinates\ninDegrees=yes\nendheader\nt\tx\ty\tz\tphi\ttheta\tpsi",
            rows(np.column_stack((PLAIN[:, :4], R.as_euler("XYZ", degrees=True))), sep="\t"),
        ),
        {"euler": "XYZ"},
        "",
    ),
    "event.csv": (text(HEAD, [*rows(PLAIN[:101]), *rows(PLAIN[100:])]), {}, "as at events (first t = 0.5 s)"),
    "gap.csv": (
        text(HEAD, [*rows(PLAIN[:100]), "0.5" + ",nan" * 7, "0.505,,,,,,,", *rows(PLAIN[102:])]),
        {},
        "2 rows that are no numbers",
    ),
    "late.csv": (text(HEAD, rows(PLAIN[1:])), {}, "its first row is at t = 0.005 s: the start of"),
    "norms.csv": (
        text(HEAD, rows(PLAIN * np.where(np.arange(8) > 3, 1.0 + 0.3 * T[:, None], 1.0))),
        {},
        "quaternions have norms of 1 to 1.3",
    ),
    "ypr.csv": (in_order("yaw,pitch,roll", "ZYX"), {"euler": "ZYX"}, ""),
    "rpy.csv": (in_order("roll,pitch,yaw", "xyz"), {"euler": "xyz"}, ""),
    "turned_names.csv": (in_order("psi,theta,phi", "ZYX"), {"euler": "ZYX"}, ""),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", SAME)
def test_one_motion_in_each_form_is_a_success(tmp_path, name):
    """To its twelve digits."""
    content, reading, words = SAME[name]
    r = judge(tmp_path, name, content, **reading)
    assert r.status == "success" and r.orientation_error_max_rad < 1e-9 and r.position_error_max_m < 1e-12
    assert words in r.notes and r.energy_drift_max_J < 1e-6


def test_rows_behind_the_end_are_said_to_be_there(tmp_path):
    r = judge(tmp_path, "more.csv", text(HEAD, rows()), replace(tumbling(), t_end=0.9))
    assert r.status == "success" and "not judged: rows behind t = 0.9 s (20, to 1 s)" in r.notes


def test_results_of_modelica_are_read(tmp_path):
    """Names along the columns of a matrix of characters; constants in a table of their own."""
    names = ["time", *(f"body.r_0[{k}]" for k in "123"), *(f"body.Q[{k}]" for k in "1234"), "body.m"]
    width = max(map(len, names))
    chars = np.array(["".join(n.ljust(width)[k] for n in names) for k in range(width)])
    info = np.array([[0] + [2] * 7 + [1], [*range(1, 9), 2], [0] * 9, [-1] * 9], dtype=np.int32)
    kind = np.array(["Atrajectory", "1.1        ", "           ", "binTrans   "])
    constants = np.array([[0.0, 1.0], [3.0, 3.0]])
    savemat(
        tmp_path / "m.mat",
        {"Aclass": kind, "name": chars, "description": chars, "dataInfo": info, "data_1": constants, "data_2": PLAIN.T},
        format="4",
    )
    r = judge(tmp_path, "again.mat", (tmp_path / "m.mat").read_bytes())
    assert r.status == "success" and r.orientation_error_max_rad < 1e-9 and "not read: body.m" in r.notes


def test_numbers_of_float32_are_known_to_their_digits(tmp_path):
    """Nine digits are printed, seven hold: the start is off by 1.2e-8 m; float64 that is off as much is refused."""
    beside = PLAIN + np.array([0, 0.7, 0, 0, 0, 0, 0, 0])
    r = judge(tmp_path, "single.csv", text(HEAD, rows(beside.astype(np.float32), "%.9g")), tumbling(0.7))
    assert r.status == "success" and r.position_error_max_m < 2e-8
    with pytest.raises(FileError, match=r"its start is not that of the problem.*--start-tolerance 2e-08 takes it"):
        judge(tmp_path, "double.csv", text(HEAD, rows(beside + np.array([0, 1.2e-8, 0, 0, 0, 0, 0, 0]))), tumbling(0.7))


REFUSED = {
    "t [ms],x [furlong],y,z": "column 'x [furlong]', read as position of C: 'furlong' is not known as a unit",
    "t [m],x,y,z": "column 't [m]', read as time: 'm' is not known as a unit",
    "t,x [mm],y,z": "column 'y', read as position of C: it has no unit, others of it have one",
    "t,x,X,y,z": "columns 'x', 'X' are all read as x; rename one",
}


@pytest.mark.parametrize("head", REFUSED)
def test_units_and_names_of_headers_are_used_or_refused(tmp_path, head):
    with pytest.raises(FileError) as error:
        judge(tmp_path, "units.csv", text(head, rows(PLAIN[:, : len(head.split(","))])))
    assert REFUSED[head] in str(error.value) and "\n" not in str(error.value)


BROKEN = {
    "0.5,oops": "line 102, field 2: expected a number (got 'oops')",
    "0.5,0,0": "line 102 has 3 fields, expected 8",
    "0.495,1,1,1,1,0,0,0": "(rows 100 and 101 have t = 0.495 and 0.495 s); the rows differ",
}


@pytest.mark.parametrize("line", BROKEN)
def test_a_broken_line_is_named_by_its_number(tmp_path, line):
    lines = rows()
    lines[100] = line + (",0" * 6 if "oops" in line else "")
    with pytest.raises(FileError) as error:
        judge(tmp_path, "broken.csv", text(HEAD, lines))
    assert BROKEN[line] in str(error.value)


def test_options_that_contradict_the_file_are_refused(tmp_path):
    """Units beside those of the header; axes of roll, pitch and yaw that are none of theirs."""
    with pytest.raises(FileError, match=r"its header has the unit 'ms'; leave --time ms out|--length cm out"):
        judge(tmp_path, "units.csv", mm_and_ms(), length="cm")
    with pytest.raises(FileError, match=r"its columns are roll, pitch, yaw, .* give --euler xyz or XYZ"):
        judge(tmp_path, "rpy.csv", in_order("roll,pitch,yaw", "xyz"), euler="ZYX")


@pytest.mark.parametrize(
    ("unit", "quantity", "factor"),
    [
        ("mm/s", "v", 1e-3),
        ("m s-1", "v", 1.0),
        ("m.s^-1", "v", 1.0),
        ("deg/s", "Omega", np.pi / 180),
        ("mm", "v", None),
        ("rpm", "Omega", np.pi / 30),
        ("rad s^-1", "Omega", 1.0),
        ("m/s", "r", None),
        ("-", "q", 1.0),
        ("deg", "R", None),
    ],
)
def test_units_are_those_of_their_quantity(unit, quantity, factor):
    assert find_factor(unit, quantity) == (None if factor is None else pytest.approx(factor))
