"""Files of other codes: an exact motion is a success, the same in other units is refused with the option that fits."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from mbsbench import Joint, RigidBody, SpringDamper, State, accelerations, assemble, load, make_problem, solve
from mbsbench.cli.__main__ import main
from mbsbench.harness.base.files import FileError
from mbsbench.harness.formats.motions.conventions import Reading
from mbsbench.harness.formats.motions.judge import FileSettings, judge_file, open_results
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.tests.comparing import assert_close

AWK = ROOT / "docs" / "examples" / "top.awk"
TOP = make_problem("heavy_top", {"t_end": 0.5})
HEADER = "t,x,y,z,q0,q1,q2,q3,vx,vy,vz,wx,wy,wz"


def exact(every: int = 1) -> np.ndarray:
    """t, r, q (w first), v, Omega of the heavy top, each millisecond."""
    t = np.linspace(0.0, 0.5, 501)[::every]
    s = TOP.reference().states(t)
    q = Rotation.from_matrix(s.R[:, 0]).as_quat(scalar_first=True)
    return np.column_stack((t, s.r[:, 0], q, s.v[:, 0], s.Omega[:, 0]))


def written(path: Path, rows: np.ndarray, header: str = "", fmt="%.9g", delimiter: str = ",") -> Path:
    header = header or ",".join(HEADER.split(",")[: rows.shape[1]])
    np.savetxt(path, rows, fmt=fmt, delimiter=delimiter, header=header, comments="")
    return path


def judge(path: Path, problem=TOP, **reading: str):
    return judge_file(problem, path, FileSettings("other", Reading(**reading)), None)


def changed(rows: slice, columns: slice | int, factor: float = 1.0, more: float = 0.0) -> np.ndarray:
    a = exact()
    a[rows, columns] = factor * a[rows, columns] + more
    return a


ALL, AFTER = slice(None), slice(1, None)  # after the start


def test_the_exact_motion_at_nine_digits_is_a_success(tmp_path):
    """All that is left is half a unit of the ninth digit: positions below 0.2 m, momenta of a few kg m/s."""
    r = judge(written(tmp_path / "top.csv", exact()))
    assert r.status == "success" and r.steps == 500 and r.solver == "other"
    assert r.position_error_max_m < 4.0 * 0.5e-9 and r.orientation_error_max_rad < 8.0 * 0.5e-9
    assert r.energy_drift_max_J < 1e-6 and r.dt_s == 0.001


def turned_to_space() -> np.ndarray:
    rows = exact()
    R = Rotation.from_quat(rows[:, 4:8], scalar_first=True)
    rows[:, 11:] = R.apply(rows[:, 11:])
    return rows


OTHERWISE = {
    "--length mm": lambda: np.column_stack((exact()[:, :1], 1e3 * exact()[:, 1:4], exact()[:, 4:8])),
    "--quaternion xyzw": lambda: exact()[:, [0, 1, 2, 3, 5, 6, 7, 4, 8, 9, 10, 11, 12, 13]],
    "--rotation space-to-body": lambda: exact() * np.array([1, 1, 1, 1, 1, -1, -1, -1, 1, 1, 1, 1, 1, 1.0]),
    "--omega space": turned_to_space,
    "--angle deg": lambda: changed(ALL, slice(11, 14), 180.0 / np.pi),
    "--time ms": lambda: changed(ALL, 0, 1e3),
}


@pytest.mark.parametrize("option", OTHERWISE)
def test_other_units_orders_and_frames_are_read_as_the_option_says(option, tmp_path):
    """With it the exact motion; without it refused, and the message names the option."""
    rows = OTHERWISE[option]()
    path = written(tmp_path / "top.csv", rows)
    name, value = option[2:].split()
    with pytest.raises(FileError, match=f"--{name}"):
        judge(path)
    r = judge(path, **{name: value})
    assert r.status == "success" and r.position_error_max_m < 4e-9 and r.orientation_error_max_rad < 8e-9


def test_orientations_that_start_alike_in_both_directions_are_found_by_their_rates(tmp_path):
    """From rest at R = 1 a rotation and its inverse begin alike; only the rates of the rows that follow differ."""
    free = make_problem("torque_free_body", {"t_end": 1.0, "rotation": (-np.pi / 2, 0.0, 0.0)})
    t = np.linspace(0.0, 1.0, 501)
    s = free.reference().states(t)
    assert_close(s.R[0, 0], np.eye(3), atol=1e-12)
    q = Rotation.from_matrix(np.swapaxes(s.R[:, 0], -1, -2)).as_quat(scalar_first=True)
    path = written(tmp_path / "body.csv", np.column_stack((t, s.r[:, 0], q, s.v[:, 0], s.Omega[:, 0])))
    r = judge(path, free)
    assert r.status == "wrong" and "from the rates of the poses in the file (--omega body" in r.notes


def test_a_quaternion_order_wrong_after_the_start_alone_does_not_pass_unnoticed(tmp_path):
    """Angular velocities that are no rates of the orientations get a note, though no reading mends them."""
    r = judge(written(tmp_path / "top.csv", changed(AFTER, 11, more=10.0)))
    assert "angular velocities are off by" in r.notes and r.status == "wrong"


@pytest.mark.parametrize(("columns", "judged"), [(4, False), (8, True)])
def test_what_is_missing_is_differenced_or_not_judged(columns, judged, tmp_path):
    """Of poses velocities follow; of positions no orientation does, and columns that need one are empty."""
    r = judge(written(tmp_path / "top.csv", exact()[:, :columns]))
    assert r.status == "success" and r.position_error_max_m < 4e-9 and "differenced" in r.notes
    assert (r.energy_drift_max_J < 1e-4) if judged else np.isnan(r.energy_drift_max_J)
    assert np.isnan(r.orientation_error_max_rad) != judged


def test_rows_too_far_apart_are_not_differenced(tmp_path):
    """At 50 rad/s a row each 50 ms says nothing about the rate of turning."""
    r = judge(written(tmp_path / "top.csv", exact(50)[:, :8]))
    assert "not judged" in r.notes and np.isnan(r.energy_drift_max_J) and r.position_error_max_m < 4e-9


def test_an_error_in_the_file_is_an_error_of_the_record(tmp_path):
    """1 mm more in x from the second row on: the position error is 1 mm, and the joint opens by as much."""
    r = judge(written(tmp_path / "top.csv", changed(AFTER, 1, more=1e-3)))
    assert r.position_error_max_m == pytest.approx(1e-3, rel=1e-6) and r.phi_max == pytest.approx(1e-3, rel=1e-5)


FORMS = {
    "top.csv": lambda path, a: written(path, a),
    "semicolons.csv": lambda path, a: path.write_text(
        HEADER.replace(",", ";") + "\n" + "\n".join(";".join(f"{x:.9g}".replace(".", ",") for x in row) for row in a)
    ),
    "blanks.txt": lambda path, a: written(path, a, HEADER.replace(",", " "), "%.12e", " "),
    "named.csv": lambda path, a: written(
        path, a, "time (s),top.r.x [m],top.r.y [m],top.r.z [m],qw,qx,qy,qz,v1_x,v1_y,v1_z,Omega_x,Omega_y,Omega_z"
    ),
    "top.npz": lambda path, a: np.savez(path, t=a[:, 0], r=a[:, 1:4], q=a[:, 4:8], v=a[:, 8:11], omega=a[:, 11:]),
    "top.mat": lambda path, a: savemat(path, {"t": a[:, 0], "r": a[:, 1:4], "q": a[:, 4:8], "w": a[:, 11:]}),
    "lying.mat": lambda path, a: savemat(path, {"t": a[:, :1].T, "r": a[:, 1:4].T, "q": a[:, 4:8].T, "w": a[:, 11:].T}),
    "top.parquet": lambda path, a: pd.DataFrame(a, columns=HEADER.split(",")).to_parquet(path),
}


@pytest.mark.parametrize("name", FORMS)
def test_each_form_of_a_table_gives_the_same_motion(name, tmp_path):
    """Delimiters, decimal commas, units in brackets, arrays either way round."""
    FORMS[name](tmp_path / name, exact())
    r = judge(tmp_path / name)
    assert r.status == "success" and r.position_error_max_m < 4e-9 and r.orientation_error_max_rad < 8e-9
    assert r.energy_drift_max_J < 1e-4


def test_several_bodies_and_a_file_of_ours_come_back_as_they_were(tmp_path):
    """The NPZ file of `solve` refereed gives its own numbers; so does a table of its two bodies in columns."""
    grid = make_problem("four_bar_grid", {"rows": 1, "columns": 1, "t_end": 0.1})
    run = solve(grid, "rk45_strong_form", rtol=1e-8)
    run.save(tmp_path / "grid.npz")
    same = judge(tmp_path / "grid.npz", grid)
    for column in ("energy_drift_max_J", "position_error_max_m", "phi_max", "orientation_error_max_rad"):
        assert getattr(same, column) == pytest.approx(getattr(run.record, column), rel=1e-6, abs=1e-12)
    s, nb = run.trajectory.states, grid.system.nb
    q = Rotation.from_matrix(s.R.reshape(-1, 3, 3)).as_quat(scalar_first=True).reshape(-1, nb * 4)
    names = [f"r{b + 1}_{a}" for b in range(nb) for a in "xyz"] + [f"q{b + 1}_{a}" for b in range(nb) for a in "wxyz"]
    rows = np.column_stack((run.trajectory.t, s.r.reshape(len(q), -1), q))
    r = judge(written(tmp_path / "grid.csv", rows, ",".join(["t", *names]), "%.15g"), grid)
    assert r.position_error_max_m == pytest.approx(run.record.position_error_max_m, rel=1e-3, abs=1e-12)


REFUSED = {
    "t,x,y,z\n0,1,2\n": "rows has|row has 3",
    "0,1,2,3\n": "no header",
    "x,y,z\n1,2,3\n": "no column t",
    "t,x,y\n0,1,2\n": "no positions",
    "t,x,y,z\n": "no rows",
    "": "no rows",
    "t,x,y,z\n0,0,-0.0342,0.0940\n0,0,-0.0342,0.0940\n": "times must increase",
    "t,x,y,z\n0,0,-0.5,0.5\n0.5,0,-0.5,0.5\n": "its start is not that of the problem",
    "t,x,y,z\n0,0,0,0\n0.5,0,0,0\n": "positions of the centre of mass .* --length m;",
    "t,x,y,z\n0.1,0,-0.0342020143,0.0939692621\n0.5,0,0,0.1\n": "first row",
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_cannot_be_read_is_refused_in_a_line(text, tmp_path):
    path = tmp_path / "top.csv"
    path.write_text(text)
    with pytest.raises(FileError, match=REFUSED[text]) as refused:
        judge(path)
    assert "\n" not in str(refused.value) and str(path) in str(refused.value)


def test_a_file_that_ends_early_names_the_option(tmp_path):
    """A success to half of the time is none; --t-end says that half was asked for."""
    path = written(tmp_path / "top.csv", exact()[:251])
    with pytest.raises(FileError, match=re.escape("--t-end 0.25")):
        judge(path)
    assert judge(path, make_problem("heavy_top", {"t_end": 0.25})).status == "success"
    r = judge(written(tmp_path / "nan.csv", changed(slice(100, None), 3, np.nan)))
    assert r.status == "diverged" and r.t_reached_s == pytest.approx(0.099)


def test_its_row_stands_beside_our_solvers(tmp_path):
    """In a results folder, with its series; another file under the same name has another address."""
    folder = open_results(tmp_path / "all")
    one = judge_file(TOP, written(tmp_path / "top.csv", exact()), FileSettings("awk_rk4"), folder)
    two = judge_file(TOP, written(tmp_path / "fine.csv", exact(), fmt="%.12g"), FileSettings("awk_rk4"), folder)
    assert one.run_id != two.run_id and one.settings_id == two.settings_id
    loaded = store.load(folder)
    assert len(loaded.records) == 2 and not loaded.unreadable
    assert load(folder).runs[0].series["position_error"].max() < 4e-9
    with pytest.raises(FileError, match="not that of a solver"):
        judge_file(TOP, tmp_path / "top.csv", FileSettings("gc_weak_form"), folder)


@pytest.mark.skipif(shutil.which("awk") is None, reason="awk is not installed")
def test_the_page_s_awk_program_is_judged(tmp_path, monkeypatch, capsys):
    """The page's commands, a folder of files included; RK4 at 1 ms follows the top to 1e-4 of its reach."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")  # no case is broken over two lines
    done = subprocess.run(("awk", "-f", str(AWK)), capture_output=True, text=True, check=True, timeout=60.0)
    Path("runs").mkdir()
    Path("runs/top.csv").write_text(done.stdout)
    shutil.copy("runs/top.csv", "runs/again.csv")
    assert main(["referee", "heavy_top", "runs/top.csv", "--t-end", "1", "--name", "awk_rk4", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["status"] == "success" and said["motion_error_max_m"] < 1e-4 * said["length_scale_m"]
    assert main(["referee", "heavy_top", "runs", "--t-end", "1", "--into", "all"]) == 0
    assert "runs[file=again]" in capsys.readouterr().out
    assert len(load("all").runs) == 2
    assert main(["verify", "all"]) == 2 and "no run that can be repeated" in capsys.readouterr().err
    assert main(["show", "all", load("all").runs[0].record.run_id]) == 0
    assert "mbsbench referee heavy_top FILE --t-end 1 --name" in capsys.readouterr().out
    assert main(["referee", "heavy_top", "runs/top.csv", "--t-end", "1", "--length", "mm"]) == 2
    assert "--length mm;" in capsys.readouterr().err


def test_export_has_all_numbers_that_a_code_needs(tmp_path):
    """A system made of them alone has the problem's own accelerations, springs and revolute joints included."""
    for name, parameters in (("heavy_top", []), ("four_bar_grid", ["--problem-set", "rows=1"])):
        assert main(["export", name, *parameters, "--out", str(tmp_path / "p.json")]) == 0
        d = json.loads((tmp_path / "p.json").read_text())
        bodies = [RigidBody(b["mass"], np.array(b["inertia"]), b["name"]) for b in d["bodies"]]
        joints = [Joint(**{k: v for k, v in j.items() if k != "type"}) for j in d["joints"]]
        system = assemble(bodies, joints, d["gravity"], [SpringDamper(**s) for s in d["springs"]])
        state = State(*(np.array([b[k] for b in d["start"]]) for k in ("r", "R", "v", "Omega")))
        p = make_problem(name, {"rows": 1} if parameters else {})
        ours, theirs = accelerations(p.system, p.initial), accelerations(system, state)
        assert_close(theirs.v_dot, ours.v_dot, atol=1e-10)
        assert d["t_end"] == p.t_end


def written_wrong_spin(path: Path, columns: int, header: str = "") -> Path:
    """The top with the sign of Omega x J Omega turned, about its fixed point: lawful, and another motion."""
    J, s, weight = np.array([0.1, 0.1, 0.01]), np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.0, -5.0 * 9.81])

    def rates(t, y):
        q, W = y[:4], y[4:]
        q_dot = 0.5 * np.array([-q[1:] @ W, *(q[0] * W + np.cross(q[1:], W))])
        moment = np.cross(s, Rotation.from_quat(q, scalar_first=True).inv().apply(weight))
        return np.concatenate((q_dot, (moment + np.cross(W, J * W)) / J))

    q = Rotation.from_matrix(TOP.initial.R[0]).as_quat(scalar_first=True)
    t = np.linspace(0.0, 0.5, 501)
    start = np.concatenate((q, TOP.initial.Omega[0]))
    y = solve_ivp(rates, (0.0, 0.5), start, "DOP853", t, rtol=1e-10, atol=1e-10).y.T
    r = Rotation.from_quat(y[:, :4], scalar_first=True).apply(s)
    return written(path, np.column_stack((t, r, y))[:, :columns], header)


def test_a_file_of_positions_is_judged_by_positions_alone(tmp_path):
    """Its joint is closed and its energy constant, with its own orientations; with the reference's neither is."""
    both = written_wrong_spin(tmp_path / "poses.csv", 8)
    alone = written_wrong_spin(tmp_path / "positions.csv", 4)
    with_orientations, r = judge(both), judge(alone)
    assert with_orientations.status == r.status == "inaccurate"
    assert with_orientations.energy_drift_max_J < 1e-3 and with_orientations.phi_max < 1e-8
    np.testing.assert_array_equal([r.energy_drift_max_J, r.phi_max, r.phi_dot_max, r.orientation_error_max_rad], np.nan)
    assert "not judged without: orientations and angular velocities, the energy error, |phi|" in r.notes
    assert r.position_error_max_m == pytest.approx(with_orientations.position_error_max_m, rel=1e-6)
    folder = open_results(tmp_path / "all")
    series = store.read_run_series(folder, judge_file(TOP, alone, FileSettings("other"), folder))
    for name in ("energy", "phi_norm", "orientation_error", "frame_q", "end_R"):  # no page draws the reference's
        np.testing.assert_array_equal(series[name], np.nan, err_msg=name)


def test_laws_are_judged_to_what_digits_and_spacing_leave(tmp_path):
    """Two decimals of the exact motion open its joint by more than is allowed; the same gap at 9 digits is wrong."""
    coarse = judge(written(tmp_path / "coarse.csv", exact(), fmt=["%.9g", *["%.2f"] * 13]))
    rows = np.array([[float(f"{x:.2f}") for x in row] for row in exact()])
    rows[0] = exact()[0]
    rows[:, 0] = exact()[:, 0]
    rows[1, 1:] += 1.23456789e-5  # nine digits in every column
    fine = judge(written(tmp_path / "fine.csv", rows))
    assert fine.status == "wrong" and coarse.status == "success"
    assert coarse.phi_max == pytest.approx(fine.phi_max, rel=0.1)


def test_the_energy_of_differenced_velocities_is_said_to_be_that(tmp_path):
    """With how far spacing and digits leave it open, which is no less than what it drifts by."""
    r = judge(written(tmp_path / "top.csv", exact(5)[:, :8]))
    (said,) = re.findall(r"that of differenced velocities, .* leave it uncertain by (\S+) J", r.notes)
    assert float(said) > r.energy_drift_max_J > 1e-3


def with_angles() -> np.ndarray:
    rows = exact()
    return np.column_stack((rows[:, :4], Rotation.from_quat(rows[:, 4:8], scalar_first=True).as_euler("ZXZ")))


def test_euler_angles_are_read_or_named_as_ignored(tmp_path):
    """With their sequence they are the exact orientations; without, one line names the option; or they are left out."""
    path = written(tmp_path / "top.csv", with_angles(), "t,x,y,z,phi,theta,psi")
    with pytest.raises(FileError, match="--euler gives their axes in the order of the columns"):
        judge(path)
    ignored = judge(path, euler="none")
    assert "not read: Euler angles" in ignored.notes and "--euler" in ignored.notes
    assert np.isnan(ignored.orientation_error_max_rad)
    r = judge(path, euler="ZXZ")
    assert r.status == "success" and r.orientation_error_max_rad < 2e-8
    with pytest.raises(FileError, match=r"its start is not that of the problem: orientations .* --euler ZYX"):
        judge(path, euler="ZYX")
    degrees = with_angles() * np.repeat((1.0, 180.0 / np.pi), (4, 3))
    assert judge(written(path, degrees, "t,x,y,z,phi,theta,psi"), euler="ZXZ", angle="deg").status == "success"
    extra = np.column_stack((exact(), exact()[:, 0]))
    assert "not read: sensor" in judge(written(path, extra, f"{HEADER},sensor")).notes


def test_the_reading_that_was_meant_is_named(tmp_path):
    """A start of no rotation, or about one axis, looks the same in either frame, and about axes that stay."""
    angles = written(tmp_path / "angles.csv", with_angles(), "t,x,y,z,phi,theta,psi")
    (note,) = re.findall(r"with (--\S+ \S+) it would follow the exact motion", judge(angles, euler="zxz").notes)
    assert note == "--euler ZXZ"
    late = written(tmp_path / "late.csv", with_angles()[1:], "t,x,y,z,phi,theta,psi")  # the start is put in front
    assert "--euler ZXZ it would follow" in judge(late, euler="zxz").notes
    assert "would follow" not in judge(angles, euler="ZXZ").notes
    unequal = {"inertia_factors": (1.0, 2.0, 3.0), "omega": (0.3, 3.0, 0.2)}
    free = make_problem(
        "torque_free_body", {"t_end": 2.0, "rotation": (-0.5 * np.pi, 0.0, 0.0), **unequal}
    )  # from R = 1
    t = np.linspace(0.0, 2.0, 401)
    states = free.reference().states(t)
    R, Omega = states.R[:, 0], states.Omega[:, 0]
    q = Rotation.from_matrix(R).as_quat(scalar_first=True)
    rows = np.column_stack((t, states.r[:, 0], q, states.v[:, 0], np.einsum("tij,tj->ti", R, Omega)))
    turned = judge(written(tmp_path / "turned.csv", rows), free)
    assert "with --omega space it would follow" in turned.notes


def test_a_remark_before_the_numbers_is_a_header(tmp_path):
    """As numpy.savetxt writes it, and Exudyn; names that are given go before it."""
    np.savetxt(tmp_path / "top.csv", exact()[:, :4], delimiter=",", header="by hand\n time, x, y, z")
    assert judge(tmp_path / "top.csv").status == "success"
    given = FileSettings("other", columns=("t", "r_x", "r_y", "r_z"))
    assert judge_file(TOP, tmp_path / "top.csv", given, None).status == "success"
    savemat(tmp_path / "ode.mat", {"tout": exact()[:, 0], "yout": exact()[:, 1:4]})
    named = FileSettings("other", columns=("t=tout", "r=yout"))
    assert judge_file(TOP, tmp_path / "ode.mat", named, None).status == "success"


def test_each_of_several_files_gets_its_verdict(tmp_path, capsys, monkeypatch):
    """One in millimetres hides no other; exit code 2, 3 where one is inaccurate alone, 0 where all are successes."""
    monkeypatch.setenv("COLUMNS", "250")
    good = str(written(tmp_path / "good.csv", exact()))
    off = str(written_wrong_spin(tmp_path / "off.csv", 11, "t,x,y,z,q0,q1,q2,q3,wx,wy,wz"))
    mm = str(written(tmp_path / "mm.csv", changed(ALL, slice(1, 4), 1e3)))
    call = ["referee", "heavy_top", "--t-end", "0.5", "--name", "mine"]
    assert main([*call, good, mm, off]) == 2
    said = capsys.readouterr().out
    assert "success" in said and "inaccurate" in said and "--length m;" in said
    assert main([*call, off]) == 3 and "inaccurate" in capsys.readouterr().out
    assert main([*call, good, good, "--json"]) == 0
