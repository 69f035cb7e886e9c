"""Check bundles of results from docs/bundle.md alone: recompute what their records state.

    python check_bundle.py [--complete] BUNDLE.zip ...

Exit code 0: all numbers agree; 1: some disagree; 2: a bundle is unreadable. One file with NumPy
alone, which shares no code with mbsbench. Names in brackets are sections of docs/bundle.md.

A reader can follow the check from top to bottom, in the order in which it is done:

 1. ``read_files``         sizes, names, digests, shapes of all members          [Files]
 2. ``Report``             runs the checks, notes agreement and disagreement
      check_head           lossless, codes, files that are required              [Files]
      check_suites         suites and environments                               [Files]
      check_table          every cell of the table                               [Table]
 3. ``Problem``            numbers and mechanics of a problem                    [A problem]
      check_problem        names and switches fit the numbers                    [Numbers]
      check_reference      the exact motion keeps the laws                       [Exact motion]
 4. for each record
      check_record         schema, code, control                                 [Record]
      check_ending         status, claimed, ended_by                             [Ending]
      check_costs          order of CPU times                                    [Costs]
      check_names          the problem of the record                             [Record]
      check_evidence       a success has its states                              [Evidence]
      read_rows            its series fill their file                            [Evidence]
 5. ``Run``, if its states are there
      check_times          first and last time                                   [Times and steps]
      check_steps          number and sizes of steps, the fixed step             [Times and steps]
      check_scales         length, speed, energy that the limits are shares of   [Scales]
      check_limits         limits of phi and phi_dot                             [Limits]
      check_trend          slope and means of the energy error                   [Energy trend]
      check_plane          distance from the plane of a planar motion            [Plane]
      check_maxima         largest and last of phi, energy, errors               [Maxima]
      check_errors_in_time how long the run tracks the exact motion              [In time]
      check_peaks          when each maximum occurred                            [Peaks]
      check_first_breaks   when each law was first broken                        [First breaks]
      check_kinematics     poses follow velocities                               [Kinematic defect]
      check_instants       error between steps, reactions                        [Instants]
      check_reaction       reactions beside the states                           [Instants]
      check_invariants     momenta, spins                                        [Invariants]
      check_rows           series of a lossless bundle                           [Series]
      check_status         success, inaccurate or wrong                          [Status]
 6. ``TruncationLaw``      velocities, accelerations and reactions follow from poses and from the
                           equations of motion, as far as the steps can tell     [Truncation]

Arrays: n states, nb bodies, nj joints (forces between bodies follow the joints), rows of phi.
"""

import dataclasses
import hashlib
import io
import json
import re
import signal
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy as np

# Limits of a file: generous for thousands of runs, and small for a computer.
FILE_NAMES = re.compile(
    r"((runs|references|series)/[\w-]{1,64}\.npy|(problems/)?[\w.-]{1,64}\.(json|toml|txt))",
    re.ASCII,
)
MANIFEST = "manifest-sha256.txt"
MAX_FILES = 20_000
MAX_BYTES = 1 << 30  # 1 GiB, packed and unpacked
MAX_JSON_BYTES = 1 << 24  # of one JSON file
MAX_JSON_VALUES = 3_000_000  # of one JSON file, counted by its commas and brackets
MAX_BODIES = 2000  # dense matrices of A must fit into memory
CENTRAL_ENTRY = b"PK\1\2"  # marks each member in the directory of an archive
PLAIN_FILE_TYPES = {0, 8}  # upper four bits of a Unix mode: none stated, regular file
PLAIN_COMPRESSIONS = {0, 8, 12}  # stored, deflate, bzip2
VERSION = 5  # of the format of bundles
SCHEMA = 3  # of records

# Differences allowed between numbers.
RELATIVE = 1e-6  # recorded from recomputed: other formulas of the same law, other libraries
ROUNDING = 1e-12  # of the terms that are added: some thousand roundings of 2e-16
STEP = 1e-30  # of complex steps: its square vanishes beside 1, its quotient is exact to rounding
CLOCK = 0.05  # [s] by which readings of two clocks may differ
MACHINE_EPSILON = np.finfo(float).eps

# What the laws allow, as shares of scales; the first two are laws of every motion.
LIMITS = {"energy": 0.1, "orthogonality": 1e-3, "gap": 0.01, "gap_rate": 0.05}
SHARE_COLUMNS = {  # where a record states the largest share of each limit
    "energy": "energy_share_max",
    "orthogonality": "orthogonality_max",
    "gap": "gap_share_max",
    "gap_rate": "gap_rate_share_max",
}
INACCURATE_LAWS = {
    "motion",
    "velocity",
    "rows",
}  # an inaccurate motion breaks these; wrong ones others
JUDGED = ("success", "inaccurate", "wrong")  # statuses of a claimed success
UNFINISHED = {  # what ends a run before its solver does
    "wall_limit",
    "cpu_limit",
    "code_limit",
    "total_limit",
    "measure_limit",
    "suspended",
}
STEP_ASKED = (0.6, 1.6)  # of dt_s: median step of a success; whole steps need not fit into t_end
SCALE_TIMES = 2000  # even intervals of the exact motion whose ends set scales
REST = 1e-6  # of the size of a mechanism: a smaller motion is rest
ACCURATE = {  # share of the length up to which the motion is followed
    "accurate_until_s": 0.1,
    "accurate_until_1pct_s": 0.01,
    "accurate_until_0p1pct_s": 0.001,
}
REACTIONS = {  # errors of reactions and the sizes they are compared with
    "reaction_error_max_N": "reaction_size_N",
    "moment_error_max_Nm": "moment_size_Nm",
}
INSTANTS = ("motion_between_max_m", *REACTIONS, *REACTIONS.values())  # each at a time of its own
STATED_MAXIMA = {  # which of the largest, the last and the largest judged have a column
    "phi": ("max", "end"),
    "phi_dot": ("max", "end"),
    "energy_drift": ("max", "end"),
    "orthogonality": ("max",),
    "gap_share": ("max",),
    "gap_rate_share": ("max",),
    "energy_share": (),
    "position_error": ("max", "judged", "end"),
    "orientation_error": ("max", "judged", "end"),
    "velocity_error": ("max",),
    "angular_velocity_error": ("max",),
    "motion_error": ("max", "judged"),
    "rate_error": ("judged",),
    "reference_own_error": ("judged",),
}
QUANTITIES = ("momentum", "angular momentum", "spin", "rate")  # that invariants are of
EXACT_SERIES = ("position_error", "orientation_error", "reference_own_error")
COSTS = (
    "cpu_min_s",
    "cpu_q1_s",
    "cpu_median_s",
    "cpu_q3_s",
    "cpu_max_s",
    "cpu_call_s",
    "cpu_import_s",
    "cpu_refuses_s",
    "cpu_process_s",
    "setup_s",
    "code_s",
    "wall_s",
    "measure_s",
    "peak_memory_MB",
    "cpu_limit_s",
    "wall_limit_s",
    "memory_limit_MB",
    "repeats",
    "events",
    "steps",
)
COMPLETE = (
    "--complete"  # option: every success has all its states, whatever the bundle calls itself
)

ZERO = np.zeros(3)
IDENTITY = np.eye(3)
PERMUTATION = np.cross(IDENTITY[:, None], IDENTITY)  # epsilon_ijk: (w x s)_i = epsilon_ijk w_j s_k

# A state is a row of 2 + 18 nb numbers: t; r, R, v, Omega of each body; what is stated.
TIME = 0
STATED = -1
BODY_NUMBERS = 18
GROUND = np.concatenate([ZERO, IDENTITY.ravel(), ZERO, ZERO])  # r, R, v, Omega of body -1


# Rotations ------------------------------------------------------------------------------------


def dot(a, b):
    """Return the products a.b of vectors along the last axis."""
    return np.einsum("...k,...k", a, b)


def norm(a):
    """Return the lengths |a| of vectors along the last axis."""
    return np.linalg.norm(a, axis=-1)


def transpose(R):
    """Return the transposes of matrices in the last two axes."""
    return np.swapaxes(R, -1, -2)


def hat(w):
    """Return the matrices of w x s (..., 3, 3) for vectors w (..., 3)."""
    return np.einsum("ijk,...j->...ik", PERMUTATION, w)


def exp(w):
    """Return the rotations (..., 3, 3) by |w| [rad] about w (..., 3): Rodrigues' formula.

    1 + sin(a)/a W + (1-cos(a))/a^2 W^2 with a = |w|; ``np.sinc(x)`` is sin(pi x)/(pi x), so no
    quotient is 0/0.
    """
    x = norm(w)[..., None, None] / np.pi
    W = hat(w)
    return IDENTITY + np.sinc(x) * W + np.sinc(x / 2) ** 2 / 2 * W @ W


def find_angle(y, x, less=0.0):
    """Return atan2(y, x) - less [rad], wrapped to -pi .. pi, for complex steps y and x.

    The imaginary part is the rate of atan2: (x y' - y x') / (x^2 + y^2).
    """
    rate = (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2)
    difference = np.arctan2(y.real, x.real) + 1j * rate - less
    return difference - 2 * np.pi * np.round(difference.real / (2 * np.pi))


def log(R, near=ZERO, rate=0):
    """Return vectors theta (..., 3) with exp(theta) = the rotation nearest to R (..., 3, 3).

    The nearest rotation is U V^T of the singular values R = U S V^T. Of the vectors that differ by
    whole turns, theta is the one nearest to the vector ``near``. With ``rate`` hat(Omega), Omega of
    the rotation, theta is complex: its imaginary part is STEP times its rate.
    """
    U, _, V = np.linalg.svd(np.where(np.isfinite(R), R, 0))
    turned = U @ V @ (IDENTITY + 1j * STEP * rate)
    axial = (turned - transpose(turned))[..., [2, 0, 1], [1, 2, 0]] / 2  # sin(a) times the axis
    cosine = (np.trace(turned, 0, -2, -1)[..., None] - 1) / 2
    sine = np.sqrt(dot(axial, axial) + 0j)[..., None]
    axis = axial / np.where(sine == 0, 1, sine)
    # half a turn has no sine: near it the longest column of (R + R^T)/2 - cos(a) is along the axis
    square = (turned + transpose(turned)) / 2 - cosine[..., None] * IDENTITY
    longest = np.argmax(np.einsum("...kk->...k", square.real), -1)[..., None, None]
    column = np.take_along_axis(square, longest, -1)[..., 0]
    length = np.sqrt(dot(column, column))[..., None]
    column = column / np.where(length == 0, 1, length)
    column = np.where(dot(axial.real, column.real)[..., None] < 0, -column, column)
    axis = np.where(cosine.real < -0.9, column, axis)
    sine = np.where(cosine.real < -0.9, dot(axial, column)[..., None], sine)
    angle = find_angle(sine, cosine)
    turns = np.round((dot(near, axis.real)[..., None] - angle.real) / (2 * np.pi))
    return axis * (angle + 2 * np.pi * turns)


@dataclasses.dataclass
class BodyStates:
    """The bodies of n states: r, v (n, nb, 3), R (n, nb, 3, 3), Omega (n, nb, 3) in the body."""

    r: np.ndarray
    R: np.ndarray
    v: np.ndarray
    Omega: np.ndarray


def unpack_states(states):
    """Return the BodyStates of states (n, 2 + 18 nb)."""
    n = len(states)
    nb = states.shape[1] // BODY_NUMBERS
    each = states[:, 1:-1].reshape(n, nb, BODY_NUMBERS)
    R = each[..., 3:12].reshape(n, nb, 3, 3)
    return BodyStates(each[..., :3], R, each[..., 12:15], each[..., 15:])


def interpolate_pose(states, t):
    """Return r (nb, 3) and R (nb, 3, 3) at a time between two states [Instants].

    Cubics with the values and the rates of both ends interpolate r, and theta in R exp(theta). With
    x = (t - t0) / h their weights are x^2 (3 - 2x) of the change, h x (1-x)^2 of the first rate,
    and h x^2 (x-1) of the last. Of the vectors theta that differ by whole turns, the nearest to the
    mean Omega is used.
    """
    times = states[:, TIME]
    k = min(max(np.searchsorted(times, t, "right") - 1, 0), len(states) - 2)
    both = unpack_states(states[k : k + 2])  # axis 0: the states before and after
    h = times[k + 1] - times[k]
    x = (t - times[k]) / h
    Omega = both.Omega
    rotation = transpose(both.R[0]) @ both.R[1]
    with_rate = log(rotation, h / 2 * Omega.sum(0), hat(Omega[1]))
    theta = with_rate.real
    # from half a turn on, where the rate of log may jump, two terms of its series in theta
    series = Omega[1] + np.cross(theta, Omega[1] / 2 + np.cross(theta, Omega[1]) / 12)
    theta_rate = np.where(norm(theta)[:, None] < np.pi, with_rate.imag / STEP, series)
    change, first, last = x**2 * (3 - 2 * x), h * x * (1 - x) ** 2, h * x**2 * (x - 1)
    shift = change * (both.r[1] - both.r[0]) + first * both.v[0] + last * both.v[1]
    turned = change * theta + first * Omega[0] + last * theta_rate
    return both.r[0] + shift, both.R[0] @ exp(turned)


# Files ----------------------------------------------------------------------------------------


def refuse_unless(condition, message):
    """Raise ValueError with a message, which refuses the bundle, unless a condition holds."""
    if not condition:
        raise ValueError(message)


def read_files(path):
    """Return the members of a bundle by name, parsed once sizes and digests are checked [Files]."""
    files = read_members(path)
    check_manifest(files)
    for name, raw in files.items():
        if name.endswith(".npy"):
            files[name] = parse_numbers(name, raw)
        elif name.endswith(".json"):
            files[name] = parse_json(name, raw)
    return files


def read_members(path):
    """Return the bytes of all members by name.

    Refuse more than 20,000 members or 1 GiB, and anything but plain files of known names.
    """
    sound = (
        path.is_file()
        and path.stat().st_size <= MAX_BYTES
        and path.read_bytes().count(CENTRAL_ENTRY) <= MAX_FILES
    )
    refuse_unless(sound, "no file of at most 1 GiB with at most 20,000 members")
    archive = zipfile.ZipFile(path)
    unpacked = sum(member.file_size for member in archive.infolist())
    refuse_unless(unpacked <= MAX_BYTES, "more than 1 GiB unpacked")
    files = {}
    for member in archive.infolist():
        name = member.orig_filename
        plain = (
            member.external_attr >> 28 in PLAIN_FILE_TYPES
            and member.compress_type in PLAIN_COMPRESSIONS
            and FILE_NAMES.fullmatch(name)
            and name not in files
        )
        refuse_unless(plain, f"unexpected, duplicate or special file {name[:80]!r}")
        files[name] = archive.open(member).read(member.file_size)
    return files


def check_manifest(files):
    """Remove the manifest from ``files``; refuse all unless it lists exactly their SHA-256."""
    listed = files.pop(MANIFEST).decode("ascii").splitlines()
    found = {f"{hashlib.sha256(raw).hexdigest()}  {name}" for name, raw in files.items()}
    wrong = sorted(set(listed) ^ found)
    refuse_unless(
        not wrong and len(listed) == len(files), f"{wrong[:1]!r:.160} differs from the manifest"
    )


def parse_numbers(name, raw):
    """Return an array of float64, a row per state or a vector; refuse times not in order."""
    values = np.lib.format.read_array(io.BytesIO(raw), allow_pickle=False).T
    times = values[:, TIME] if values.ndim == 2 else ZERO[:1]
    ordered = np.isfinite(times).all() and (np.diff(times) > 0).all()
    refuse_unless(values.dtype == "<f8" and ordered, f"{name}: no numbers, or times not in order")
    return values


def parse_json(name, raw):
    """Return the content of a JSON file; refuse one that is too large or has a key twice."""
    values = raw.count(b",") + raw.count(b"[") + raw.count(b"{")
    refuse_unless(len(raw) <= MAX_JSON_BYTES and values <= MAX_JSON_VALUES, f"{name} is too large")
    return json.loads(raw, object_pairs_hook=read_object)


def read_object(pairs):
    """Return a JSON object as a dictionary; refuse a key that occurs twice."""
    found = dict(pairs)
    refuse_unless(len(found) == len(pairs), "a key twice")
    return found


# Rows of phi ----------------------------------------------------------------------------------


@dataclasses.dataclass
class Geometry:
    """The joints at n states, in space: vectors (n, nj, 3), matrices (n, nj, 3, 3).

    Quantities are complex steps: a + i STEP a', with a' the rate.
    """

    r_i: np.ndarray  # of C of body i
    R_i: np.ndarray
    r_j: np.ndarray
    R_j: np.ndarray
    x_i: np.ndarray  # the joint's point in body i, r + R s
    x_j: np.ndarray
    d: np.ndarray  # x_i - x_j
    u: np.ndarray  # directions in body i
    w: np.ndarray
    n1: np.ndarray  # directions in body j
    n2: np.ndarray
    n3: np.ndarray
    f: np.ndarray  # (n, nj): prescribed motion f(t)
    length: np.ndarray  # (nj): L
    is_distance: np.ndarray  # (nj)
    own_u: np.ndarray  # (nj, 3): u and w as numbers, not turned
    own_w: np.ndarray


def list_point_rows(g):
    """Return the rows of common points: d = 0 [m]."""
    return [g.d[..., 0], g.d[..., 1], g.d[..., 2]]


def list_line_rows(g):
    """Return the rows of lines: n_k.d = 0 [m]; the row of a distance is (d.d - L^2) / 2L."""
    distance = (dot(g.d, g.d) / g.length - g.length) / 2
    first = np.where(g.is_distance, distance, dot(g.n1, g.d))
    return [first, dot(g.n2, g.d), dot(g.n3, g.d)]


def list_axis_rows(g):
    """Return the rows of axes: u.n1 = u.n2 = w.n2 = 0 [-]."""
    return [dot(g.u, g.n1), dot(g.u, g.n2), dot(g.w, g.n2)]


def list_driven_position_rows(g):
    """Return the row n1.d - f = 0 [m]."""
    return [dot(g.n1, g.d) - g.f]


def list_driven_distance_rows(g):
    """Return the row |d| - f = 0 [m]."""
    return [np.sqrt(dot(g.d, g.d)) - g.f]


def list_driven_angle_rows(g):
    """Return the row u.(n1 cos f + n2 sin f) = 0 [-]."""
    return [dot(g.u, g.n1) * np.cos(g.f) + dot(g.u, g.n2) * np.sin(g.f)]


def list_knife_edge_rows(g):
    """Return the row whose rate is u.(v_i - v_j) - f = 0 [m/s], both velocities at x_i."""
    return [dot(g.u.real, find_slip(g, g.x_i)) - 1j * STEP * g.f.real]


def list_rolling_disc_rows(g):
    """Return n1.(x - x_j) = 0 [m], and rows whose rates are n2 and n3.(v_i - v_j) = 0 [m/s] at x.

    x = x_i - L unit(n1 - (n1.u) u) is the lowest point of the disc of radius L about u.
    """
    upward = g.n1 - dot(g.n1, g.u)[..., None] * g.u
    lowest = g.x_i - g.length[:, None] * upward / np.sqrt(dot(upward, upward))[..., None]
    slip = find_slip(g, lowest)
    return [dot(g.n1, lowest - g.x_j), dot(g.n2.real, slip), dot(g.n3.real, slip)]


def find_slip(g, point):
    """Return i STEP (v_i - v_j), with the velocities of both bodies at a point (n, nj, 3).

    They are those of the material of each body at that point.
    """

    def move_matter(r, R):
        at_rest = R.real.swapaxes(2, 3) @ (point - r).real[..., None]  # the point in the body frame
        return (r + (R @ at_rest)[..., 0]).imag

    return 1j * (move_matter(g.r_i, g.R_i) - move_matter(g.r_j, g.R_j))


def list_rack_and_pinion_rows(g):
    """Return the row L wrap(atan2(a.(e x u), e.u) - e.d / L) = 0 [m] with e = -n2, a = n1 x n2."""
    across, along = dot(np.cross(g.n1, g.n2), np.cross(g.u, g.n2)), -dot(g.n2, g.u)
    return [g.length * find_angle(across, along, -dot(g.n2, g.d) / g.length)]


def list_spring_rows(g):
    """Return the elongation of a spring, |d| - L [m]."""
    return [np.sqrt(dot(g.d, g.d)) - g.length]


def list_torsion_rows(g):
    """Return the turn of a torsion spring, wrap(atan2(u.n2, u.n1) - L) [rad]."""
    return [find_angle(dot(g.u, g.n2), dot(g.u, g.n1), g.length)]


def list_load_rows(g):
    """Return a row whose rate is the power of force f u at x_i and torque f w on body i [W].

    u and w turn with the body where L is 1, else they are fixed in space.
    """
    turns = g.length[:, None] > 0
    force = g.f.real[..., None] * np.where(turns, g.u.real, g.own_u)
    torque = g.f.real[..., None] * np.where(turns, g.w.real, g.own_w)
    by_force = dot(force, g.x_i.imag)
    by_torque = np.sum(hat(torque) @ g.R_i.real * g.R_i.imag, (2, 3)) / 2  # R' = hat(omega) R
    return [1j * (by_force + by_torque)]


ROW_FUNCTIONS = {  # the rows of a kind, and how many there are
    "points": (list_point_rows, 3),
    "lines": (list_line_rows, 3),
    "axes": (list_axis_rows, 3),
    "driven position": (list_driven_position_rows, 1),
    "driven distance": (list_driven_distance_rows, 1),
    "driven angle": (list_driven_angle_rows, 1),
    "spring": (list_spring_rows, 1),
    "knife edge": (list_knife_edge_rows, 1),
    "rolling disc": (list_rolling_disc_rows, 3),
    "rack and pinion": (list_rack_and_pinion_rows, 1),
    "torsion": (list_torsion_rows, 1),
    "load": (list_load_rows, 1),
}
FORCES = ("spring", "torsion", "load")  # beside the joints: no constraints
PLACES = [(kind, k) for kind, (_, count) in ROW_FUNCTIONS.items() for k in range(count)]
DRIVEN_ANGLE = PLACES.index(("driven angle", 0))
THIRD_AXIS = PLACES.index(("axes", 2))
HALF_TURN_PLACES = [THIRD_AXIS, DRIVEN_ANGLE]  # rows that are 0 half a turn off, too
ANGLE_PLACES = [PLACES.index(("axes", k)) for k in range(3)] + [DRIVEN_ANGLE]  # rows without unit


# A problem ------------------------------------------------------------------------------------

SHAPES = {  # of numbers: by bodies, user forces or joints, then axes of fixed size
    "mass": ("body",),
    "inertia": ("body", 3, 3),
    "gyration": ("body",),
    "gravity": (3,),
    "start_r": ("body", 3),
    "start_R": ("body", 3, 3),
    "start_v": ("body", 3),
    "start_Omega": ("body", 3),
    "user_i": ("user",),
    "user_j": ("user",),
    "joint_i": ("joint",),
    "joint_j": ("joint",),
    "joint_s_i": ("joint", 3),
    "joint_s_j": ("joint", 3),
    "joint_u": ("joint", 3),
    "joint_w": ("joint", 3),
    "joint_n": ("joint", 3, 3),
    "joint_length": ("joint",),
    "joint_motion": ("joint", 7),
    "joint_k": ("joint",),
    "joint_c": ("joint",),
    "joint_points": ("joint",),
    "joint_lines": ("joint",),
    "joint_axes": ("joint",),
    "joint_moving": ("joint",),
}
BODY_INDICES = ("user_i", "user_j", "joint_i", "joint_j")  # -1 is the ground


class Problem:
    """The numbers of a problem, its exact motion, and the mechanics of its states.

    Numbers have the names of [Numbers] without ``joint_``: mass (nb), inertia (nb, 3, 3), i, j
    (nj), s_i, s_j, u, w (nj, 3), n (nj, 3, 3), length (nj), motion (nj, 7), and so on.
    """

    def __init__(self, data, exact, name):
        self.kinds = np.array(data["joint_kinds"], "U40")
        self.t_end = float(data["t_end_s"])
        self.read_numbers(data["numbers"], name)
        self.place_rows()
        self.read_switches(data)
        self.find_mechanisms()
        self.read_exact(exact, data["reference"])

    def read_numbers(self, numbers, name):
        """Set every number as an attribute; refuse one not finite or of a wrong shape [Numbers]."""
        sizes = {}  # how many bodies, user forces and joints: of the first array of each
        for key, axes in SHAPES.items():
            values = np.array(numbers[key], float)
            if isinstance(axes[0], str):
                sizes.setdefault(axes[0], len(values))
            shape = tuple(sizes.get(axis, axis) for axis in axes)
            if 0 in shape:  # an empty list has lost its other axes
                values = values.reshape(shape)
            known = values.shape == shape and np.isfinite(values).all()
            if key in BODY_INDICES:
                known = known and not ((values < -1) | (values >= sizes["body"])).any()
                values = values.astype(int) if known else values
            refuse_unless(
                known, f"{name}: {key} is not finite, of shape {shape} or beyond the bodies"
            )
            setattr(self, key.removeprefix("joint_"), values)
        self.nb = sizes["body"]
        self.user_count = sizes["user"]
        sound = (
            0 < self.nb <= MAX_BODIES
            and max(sizes.values()) <= 50 * self.nb + 50
            and (self.mass > 0).all()
            and 0 < self.t_end < np.inf
            and len(self.kinds) == sizes["joint"]
            and set(self.kinds[self.moving > 0]) <= set(ROW_FUNCTIONS) - {"points", "lines", "axes"}
            and np.isin([self.points, self.lines, self.axes, self.moving], range(4)).all()
        )
        refuse_unless(sound, f"{name}: bodies, masses, joint_kinds or t_end_s")
        normal = numbers.get("planar_normal")
        self.normal = None if normal is None else np.array(normal, float).reshape(3)

    def place_rows(self):
        """Set the joint and the place in PLACES of each row, joint by joint, and masks [Rows]."""
        counts = {"points": self.points, "lines": self.lines, "axes": self.axes}
        for kind in ROW_FUNCTIONS:
            counts.setdefault(kind, self.moving * (self.kinds == kind))
        has_row = np.array([counts[kind] > k for kind, k in PLACES])  # (places, nj)
        self.row_joint, self.row_place = np.nonzero(has_row.T)  # both (rows)
        self.row_kinds = {PLACES[place][0] for place in self.row_place}
        self.is_joint = ~np.isin(self.kinds, FORCES)  # (nj)
        self.row_is_joint = self.is_joint[self.row_joint]  # (rows), as the next two
        self.row_is_load = (self.kinds == "load")[self.row_joint]
        self.row_is_angle = np.isin(self.row_place, ANGLE_PLACES)

    def read_switches(self, data):
        """Set the switches of laws: literal start, user forces, work, invariants."""
        self.literal = bool(data["literal_start"])
        self.has_user_forces = bool(self.user_count or data["not_serialised"])
        self.set_work()
        self.invariants = {about["name"]: about for about in data["invariants"]}
        self.laws = ["energy", "orthogonality"]
        if self.is_joint.any() and not self.literal:
            self.laws += ["gap", "gap_rate"]

    def set_work(self):
        """Set the mask (nj) of the joints and forces that do work [Energy].

        A damper has c and a row; a drive, knife edge or load has a row and an f that is not 0, and
        a load a force or torque, too. Numbers without effect switch no law off.
        """
        a, w, p = self.motion[:, 4:].T
        has_f = (self.motion[:, :4] != 0).any(1) | ((a != 0) & ((w != 0) | (p != 0)))
        pushes = (self.u != 0).any(1) | (self.w != 0).any(1)
        is_drive = np.char.startswith(self.kinds, "driven") | (self.kinds == "knife edge")
        is_damper = np.isin(self.kinds, ("spring", "torsion"))
        works = (is_drive & has_f) | ((self.kinds == "load") & has_f & pushes)
        works |= is_damper & (self.c != 0)
        self.works = works & (self.moving > 0)  # (nj)
        self.has_work = bool(self.has_user_forces or self.works.any())

    def does_work(self, part):
        """Return whether work is done on the bodies in a mask ``part`` (nb) of a mechanism."""
        with_ground = np.append(part, False)
        joints = with_ground[self.i] | with_ground[self.j]
        forces = with_ground[self.user_i] | with_ground[self.user_j]
        return bool((joints & self.works).any() or forces.any())

    def find_mechanisms(self):
        """Set the mechanisms, which joints and forces connect, held bodies and arms [Mechanisms].

        mechanisms: list of masks (nb); held (nb): by a joint, spring or user force at the ground;
        arm (nb): |s| of the farthest joint, or the gyration if that is longer [m]; arm_sum (nb):
        sum of |s|; is_loose (nb): has a joint without point rows; rim: size of all bodies [m].
        """
        ends_i = np.append(self.i, self.user_i)
        ends_j = np.append(self.j, self.user_j)
        group = np.arange(self.nb)
        for i, j in zip(ends_i, ends_j, strict=True):
            if i >= 0 and j >= 0:
                group[group == group[i]] = group[j]
        self.mechanisms = [group == number for number in np.unique(group)]
        self.all_bodies = np.ones(self.nb, bool)

        at_ground = (ends_i < 0) | (ends_j < 0)
        holds = np.append(self.is_joint | (self.kinds == "spring"), np.ones(self.user_count, bool))
        holding = at_ground & holds
        self.held = np.isin(np.arange(self.nb), [ends_i[holding], ends_j[holding]])

        body = np.append(self.i, self.j)  # of each end of each joint, -1 the ground
        arms = norm(np.append(self.s_i, self.s_j, 0)) * np.tile(self.is_joint, 2)
        farthest = np.append(self.gyration, 0)  # the last is the ground
        np.maximum.at(farthest, body, arms)
        self.arm = farthest[:-1]
        self.arm_sum = np.bincount(body + 1, arms, self.nb + 1)[1:]  # the first is the ground
        self.longest_arm = np.zeros(self.nb + 1)  # of joints alone, the last of the ground
        np.maximum.at(self.longest_arm, body, arms)
        pointless = np.tile(self.is_joint & (self.points < 1), 2)
        self.is_loose = np.bincount(body + 1, pointless, self.nb + 1)[1:] > 0
        self.rim = self.gyration.max() + self.arm_sum.sum()

    def read_exact(self, exact, reference):
        """Set the start, the exact motion, and its states that set scales, all (n, 2 + 18 nb)."""
        bodies = [self.start_r, self.start_R, self.start_v, self.start_Omega]
        bodies = np.concatenate([values.reshape(self.nb, -1) for values in bodies], 1)
        self.start = np.array([[0, *bodies.ravel(), 0]])
        self.route = str(reference["route"])
        self.horizon, self.exact = -np.inf, self.start[:0]
        if exact is not None:
            self.horizon, self.exact = float(reference["horizon_s"]), exact
            sound = exact.shape[1:] == self.start.shape[1:] and len(exact) and self.horizon >= 0
            refuse_unless(sound, "a reference without states of this problem, or without a horizon")
        self.covered_to = self.horizon * (1 + ROUNDING)  # [s] the last time that is within
        even = self.exact[:, TIME] / min(self.t_end, self.horizon) * SCALE_TIMES
        near = np.abs(even - np.round(even)) < 1e-7  # times are written to 16 digits
        sets_scales = near & (even <= SCALE_TIMES * (1 + ROUNDING))
        self.scale_states = np.append(self.start, self.exact[sets_scales], 0)

    def find_motion_distance(self, dr, D):
        """Return sqrt(|dr|^2 + tr(D S D^T) / m), S = tr(J)/2 - J: (n, nb) [m, or m/s of rates].

        It is the root mean square of dr + D s over the matter s of a body, of differences of poses,
        velocities or accelerations: dr (n, nb, 3), D (n, nb, 3, 3) [Errors].
        """
        trace = np.trace(self.inertia, axis1=1, axis2=2)[:, None, None]
        S = trace * IDENTITY / 2 - self.inertia
        turned = np.einsum("tbij,bjk,tbik->tb", D, S, D) / self.mass
        return np.sqrt(dot(dr, dr) + np.maximum(turned, 0))

    def find_speed(self, v, Omega):
        """Return sqrt(v^2 + Omega.J Omega / m) of each body (n, nb) [m/s]: T is m speed^2 / 2."""
        return self.find_motion_distance(v, hat(Omega))

    def find_rows(self, states, velocities=None, ahead=0.0):
        """Return phi and phi_dot (n, rows), and which gaps are half a turn off (n, rows) [Rows].

        The velocities are those of the states; or ((v_i, Omega_i), (v_j, Omega_j)) of every joint,
        with time held fixed. ``ahead`` [s] moves poses and times forward by that much.
        """
        g = self.place_joints(states, velocities, ahead)
        nothing = np.zeros((len(states), len(self.kinds)))
        table = []  # by place: complex steps (n, nj)
        for kind, (list_rows, count) in ROW_FUNCTIONS.items():
            table += list_rows(g) if kind in self.row_kinds else [nothing] * count
        # axes of the table: place, state, joint; of its rows: row, state
        rows = np.array(table)[self.row_place, :, self.row_joint].T

        opposed = np.where(
            self.kinds == "driven angle",
            dot(g.u, g.n2) * np.cos(g.f) - dot(g.u, g.n1) * np.sin(g.f),
            -dot(g.w, g.n1),
        )
        half_turned = (opposed.real > 0)[:, self.row_joint]
        half_turned &= np.isin(self.row_place, HALF_TURN_PLACES)
        return rows.real, rows.imag / STEP, half_turned

    def find_reversed_joints(self, states):
        """Return the mask (nj) of joints whose u reverses its direction along n3 [Gaps].

        It is compared with that at the start; only two or three axis rows align u with n3.
        """

        def find_sides(some):
            ground = np.tile(IDENTITY, (len(some), 1, 1, 1))
            R = np.append(unpack_states(some).R, ground, 1)  # index -1 is the ground
            u = np.einsum("tkij,kj->tki", R[:, self.i], self.u)
            return dot(u, np.einsum("tkij,kj->tki", R[:, self.j], self.n[:, 2]))

        size = max(1, 60_000 // max(self.nb, len(self.i)))  # states at once, as in measure_series
        start, turned = find_sides(self.start), np.zeros(len(self.i), bool)
        for k in range(0, len(states), size):
            turned |= (find_sides(states[k : k + size]) * start < 0).any(0)
        return turned & (self.axes > 1)

    def place_joints(self, states, velocities, ahead):
        """Return the Geometry of all joints, with the ground as one more body at rest."""
        n = len(states)
        with_ground = np.concatenate([states[:, :-1], np.tile(GROUND, (n, 1)), states[:, -1:]], 1)
        bodies = unpack_states(with_ground)  # index -1 is the ground
        step = 1j * STEP
        ends = []
        for end, body in enumerate((self.i, self.j)):
            if velocities is None:
                v, Omega = bodies.v[:, body], bodies.Omega[:, body]
            else:
                v, Omega = velocities[end]
            r = bodies.r[:, body] + (ahead + step) * v
            R = bodies.R[:, body] @ (IDENTITY + ahead * hat(Omega)) @ (IDENTITY + step * hat(Omega))
            ends.append((r, R))
        (r_i, R_i), (r_j, R_j) = ends

        t = states[:, :1] + ahead + step * (velocities is None)
        c0, c1, c2, c3, a, w, p = self.motion.T
        f = c0 + t * (c1 + t * (c2 + t * c3)) + a * np.sin(w * t + p)

        def to_space(R, a):
            return np.einsum("tkij,kj->tki", R, a)

        x_i, x_j = r_i + to_space(R_i, self.s_i), r_j + to_space(R_j, self.s_j)
        return Geometry(
            r_i,
            R_i,
            r_j,
            R_j,
            x_i,
            x_j,
            x_i - x_j,
            u=to_space(R_i, self.u),
            w=to_space(R_i, self.w),
            n1=to_space(R_j, self.n[:, 0]),
            n2=to_space(R_j, self.n[:, 1]),
            n3=to_space(R_j, self.n[:, 2]),
            f=f,
            length=self.length,
            is_distance=self.kinds == "distance",
            own_u=self.u,
            own_w=self.w,
        )

    def measure_series(self, states, part):
        """Return the series (n) of the mechanism of the bodies in a mask ``part`` (nb), by name.

        phi, phi_dot, gap, gap_rate: norms over rows [Gaps]; orthogonality; reach [m]; speed [m/s];
        momentum [kg m/s]; T, V, E [J].
        """
        size = max(1, 60_000 // max(self.nb, len(self.i)))  # states at once: memory of some 100 MB
        starts = range(0, max(len(states), 1), size)
        pieces = [self.measure_piece(states[k : k + size], part) for k in starts]
        return {key: np.concatenate([piece[key] for piece in pieces]) for key in pieces[0]}

    def measure_piece(self, states, part):
        """Return the series of ``measure_series`` for a few states."""
        b, start = unpack_states(states), unpack_states(self.start)
        mass = self.mass * part
        phi, phi_dot, half_turned = self.find_rows(states)
        series = self.measure_rows(phi, phi_dot, half_turned, part)

        # a mechanism that no joint holds to the ground is measured from its common C
        share = mass / mass.sum()
        if (part & self.held).any():
            share = 0 * share
        r = b.r - (share @ b.r)[:, None]
        v = b.v - (share @ b.v)[:, None]
        start_r = start.r - (share @ start.r)[:, None]
        reach = self.find_motion_distance(r - start_r, b.R - start.R)
        speed = self.find_speed(v, b.Omega)
        orthogonality = np.linalg.norm(transpose(b.R) @ b.R - IDENTITY, axis=(2, 3))
        series["reach"] = reach[:, part].max(1)
        series["speed"] = speed[:, part].max(1)
        series["orthogonality"] = orthogonality[:, part].max(1)
        series["momentum"] = speed @ mass

        # E = sum (m v^2 + Omega.J Omega) / 2 - m gravity.r + sum k phi^2 / 2 [Energy]; T and V are
        # its parts, of r and v from the common C
        elastic = phi**2 @ (self.select_rows(part) * self.k[self.row_joint]) / 2
        series["elastic"] = elastic
        series["T"] = speed**2 @ mass / 2
        series["V"] = elastic + r @ -self.gravity @ mass
        kinetic = self.find_speed(b.v, b.Omega) ** 2 @ mass / 2
        series["E"] = kinetic + b.r @ -self.gravity @ mass + elastic
        return series

    def select_rows(self, part):
        """Return the mask (rows) of the rows that act on the bodies in a mask ``part`` (nb)."""
        with_ground = np.append(part, False)
        return (with_ground[self.i] | with_ground[self.j])[self.row_joint]

    def measure_rows(self, phi, phi_dot, half_turned, part):
        """Return the norms over the joints' rows of a mechanism [Gaps].

        In the gap [m] and its rate [m/s], rows without unit count times the largest gyration; rows
        of phi that are half a turn off count 2 - |phi|.
        """
        rows = self.select_rows(part) & self.row_is_joint
        metres = np.where(self.row_is_angle, self.gyration[part].max(), 1.0)
        gap = np.where(half_turned, 2 - np.abs(phi), phi) * metres
        series = {"phi": phi, "phi_dot": phi_dot, "gap": gap, "gap_rate": metres * phi_dot}
        return {key: norm(values[:, rows]) for key, values in series.items()}

    def find_scales(self, states, first_break, is_whole, part):
        """Return the series of a mechanism and its scales [Scales].

        Scales are maxima over the exact motion to its horizon, and over steps of the run beyond it
        before the first break [s] of a law. If neither moves, and the whole motion is known, they
        are the scales of a mechanism at rest.
        """
        series = self.measure_series(states, part)
        exact = self.measure_series(self.scale_states, part)
        t = states[:, TIME]
        energy_start = exact["E"][0] if t[0] else series["E"][0]
        series["energy"] = states[:, STATED] if self.does_work(part) else series["E"] - energy_start
        beyond = t > self.covered_to
        at_rest = self.find_scales_at_rest(exact, part)
        least = REST * at_rest["length"]
        rests = is_whole and not (exact["reach"] > least).any()
        rests = rests and not (series["reach"][beyond] > least).any()
        if rests and not (self.measure_series(self.exact, part)["reach"] > least).any():
            return series, at_rest | {"energy start": energy_start}

        late = beyond & (t < first_break)

        def join(key):
            return np.append(exact[key], series[key][late])

        reach, speed, V, momentum = join("reach"), join("speed"), join("V"), join("momentum")
        gained = np.maximum(series["energy"][late], 0)  # an error, not energy to be exchanged
        T = np.append(exact["T"], series["T"][late] - gained)
        stretch = np.inf  # how far apart joints with points could be
        if not self.is_loose[part].any():
            stretch = 2 * (self.arm_sum[part].sum() + self.gyration[part].max())
        return series, {
            "reach": reach.max(),
            "length": (exact["reach"] if len(self.exact) else reach).max(),
            "stretch": stretch,
            "gap": min(reach.max(), stretch),
            "gap_rate": speed.max(),
            "momentum": momentum.max(),
            "orthogonality": 1.0,
            "energy": max(T.max(), np.ptp(V)),
            "energy start": energy_start,
            "energy terms": (T + np.abs(join("E") - join("T"))).max(),
            "is rest": False,
        }

    def find_scales_at_rest(self, exact, part):
        """Return the scales of a mechanism that stays at rest, from its numbers alone [Scales].

        Length L: its longest arm of a joint, largest gyration or spread of the C's. Energy: T(0) +
        m g L + that of springs, at least m (1e-6 L)^2; speed: sqrt(2 energy / m).
        """
        spread = norm(np.ptp(self.start_r[part], 0))
        length = max(self.gyration[part].max(), spread, self.longest_arm[:-1][part].max())
        mass = self.mass[part].sum()
        speed = self.find_speed(self.start_v[None], self.start_Omega[None])[0]
        kinetic = max(exact["T"][0], REST * (self.mass * part) @ speed**2 / 2)
        energy = kinetic + mass * norm(self.gravity) * length + exact["elastic"][0]
        energy = max(energy, mass * (1e-6 * length) ** 2)
        speed = np.sqrt(2 * energy / mass)
        return {
            "reach": length,
            "length": length,
            "stretch": np.inf,
            "gap": length,
            "gap_rate": speed,
            "momentum": mass * speed,
            "orthogonality": 1.0,
            "energy": energy,
            "energy terms": energy + np.abs(exact["E"][0]),
            "is rest": True,
        }

    def differentiate(self, states):
        """Return A (n, rows, nb, 6): the rate of each phi per unit of v and Omega of each body."""
        rows = np.arange(len(self.row_joint))
        A = np.zeros((len(states), len(rows), self.nb + 1, 6))  # the last body is the ground
        still = self.find_rows(states, np.zeros((2, 2, 3)))[1]
        for end, bodies in enumerate((self.i, self.j)):
            for k in range(6):
                velocities = np.zeros((2, 2, 3))  # axes: end, v or Omega, direction
                velocities[end, k // 3, k % 3] = 1
                change = self.find_rows(states, velocities)[1] - still
                A[:, rows, bodies[self.row_joint], k] += change
        return A[:, :, :-1]

    def accelerate(self, states):
        """Return rates a of (v, Omega), and the joints' loads on bodies, (n, nb, 6) [Equations].

        M a = f + A^T lambda, with phi_ddot = A a - drift = 0. f: m gravity, -Omega x J Omega, and
        of springs, torsions and loads -A^T (k phi + c phi_dot) and A^T. The loads A^T lambda = M a
        - f are forces [N] in space and moments [N m] in the body.
        """
        Omega = unpack_states(states).Omega
        phi, phi_dot, _ = self.find_rows(states)
        A = self.differentiate(states)
        n, nb, size = len(states), self.nb, 6 * self.nb
        along_rows = (
            self.k[self.row_joint] * phi + self.c[self.row_joint] * phi_dot - self.row_is_load
        )
        f = -np.einsum("tr,trbk->tbk", along_rows, A)
        weight = np.zeros((n, nb, 3)) + self.mass[:, None] * self.gravity
        gyroscopic = -np.einsum("tbij,bjk,tbk->tbi", hat(Omega), self.inertia, Omega)
        f += np.append(weight, gyroscopic, 2)

        M = np.zeros((nb, 6, nb, 6))
        for body in range(nb):
            M[body, :3, body, :3] = self.mass[body] * IDENTITY
            M[body, 3:, body, 3:] = self.inertia[body]
        M = np.tile(M.reshape(size, size), (n, 1, 1))
        A = A[:, self.row_is_joint].reshape(n, -1, size)
        # central difference of phi_dot along the motion, over 1e-5 of the fastest turn: errors of
        # its square and of rounding over it are both 1e-10 or so
        h = 1e-5 / max(1, np.abs(Omega).max(), np.abs(self.motion[:, 5]).max(initial=0))
        before, after = self.find_rows(states, ahead=-h)[1], self.find_rows(states, ahead=h)[1]
        drift = (before - after)[:, self.row_is_joint, None] / (2 * h)

        unit = self.mass.max()  # so that entries of M and A are comparable
        no_block = np.zeros((n, A.shape[1], A.shape[1]))
        matrix = np.block([[M / unit, A.swapaxes(1, 2)], [A, no_block]])
        right = np.append(f.reshape(n, size, 1) / unit, drift, 1)
        # the pseudo-inverse: rows may be redundant, where a and the loads are unique all the same
        a = (np.linalg.pinv(matrix, 1e-12, hermitian=True) @ right)[:, :size]
        return a.reshape(f.shape), (M @ a).reshape(f.shape) - f

    def move(self, states, step):
        """Return states with poses moved by step (n, nb, 6): [m] in space, [rad] in the body."""
        n = len(states)
        moved = states.copy()
        each = states[:, 1:-1].reshape(n, self.nb, BODY_NUMBERS).copy()
        R = each[..., 3:12].reshape(n, self.nb, 3, 3) @ exp(step[..., 3:])
        each[..., :3] = each[..., :3] + step[..., :3]
        each[..., 3:12] = R.reshape(n, self.nb, 9)
        moved[:, 1:-1] = each.reshape(n, -1)
        return moved

    def project(self, states):
        """Return states with the nearest poses on phi = 0, by mass and gyration [Truncation].

        Newton's steps y = A^+ phi of each state, with rows scaled to one, end when phi is rounding
        or no longer halves; a step that increases it is undone.
        """
        if not self.row_is_joint.any():
            return states.copy()
        states, last = states.copy(), states.copy()
        by_axis = np.repeat(np.stack([np.ones(self.nb), self.gyration], 1), 3, 1)
        weight = np.sqrt(self.mass)[:, None] * by_axis  # (nb, 6)
        size = np.abs(unpack_states(states).r).max(initial=0) + self.arm.max()
        near = 64 * MACHINE_EPSILON * size
        metres = np.where(self.row_is_angle, self.gyration.max(), 1)[self.row_is_joint]
        left = np.arange(len(states))  # the states that still move
        gap_before = np.full(len(states), np.inf)  # their gaps a step ago
        for _ in range(8):
            phi = self.find_rows(states[left])[0][:, self.row_is_joint]
            gap = np.abs(phi * metres).max(1)
            worse = left[~(gap < gap_before)]
            states[worse] = last[worse]
            on = np.isfinite(gap) & (gap > near) & (gap < 0.5 * gap_before)
            left, phi, gap_before = left[on], phi[on], gap[on]
            if not len(left):
                break
            last[left] = states[left]
            A = self.differentiate(states[left])[:, self.row_is_joint] / weight
            A = A.reshape(*phi.shape, -1)
            row_length = norm(A)
            row_length[row_length == 0] = 1
            inverse = np.linalg.pinv(A / row_length[..., None], 1e-5)
            y = np.einsum("tmr,tr->tm", inverse, phi / row_length)
            step = -y.reshape(len(left), self.nb, 6) / weight
            states[left] = self.move(states[left], step)
        return states

    def find_top_error(self):
        """Return the deviation of the exact motion from that of Lagrange's top [Exact motion].

        This is a closed form: the cosine u to the vertical obeys u'^2 = d (u - u1)(u - u2)(u - u3),
        so that u = u1 + (u2 - u1) sn^2: its phase grows with time. The deviation (n), without unit,
        is the error of the phase times u' over its speed, plus the distance of u from u1 .. u2.
        """
        top = unpack_states(np.append(self.start, self.exact, 0))  # the first is the start
        J, m, size, g = self.inertia[0], self.mass[0], norm(self.s_i[0]), norm(self.gravity)
        Omega = top.Omega[:, 0]
        arm = -self.s_i[0] / size  # from the fixed point to C, in the body
        up = -self.gravity / g @ top.R[:, 0]  # in the body
        J_axial = arm @ J @ arm
        J_pivot = (np.trace(J) - arm @ J @ arm) / 2 + m * size**2  # across, about the fixed point
        u = up @ arm
        du = dot(up, np.cross(Omega, arm))
        spin = Omega[0] @ arm
        # with c = J_axial spin / J_pivot, d = 2 m g size / J_pivot, and a, b from energy and the
        # vertical momentum: u'^2 = (a - d u)(1 - u^2) - (b - c u)^2
        c, d = J_axial * spin / J_pivot, 2 * (m * size * g) / J_pivot
        a = Omega[0] @ Omega[0] - spin**2 + d * u[0]
        b = up[0] @ (Omega[0] - arm * spin) + c * u[0]
        u1, u2, u3 = np.sort(np.roots([d, -a - c**2, 2 * b * c - d, a - b**2]).real)
        modulus = (u2 - u1) / (u3 - u1)
        speed = np.sqrt(d * (u3 - u1)) / 2
        # elliptic integrals of the first kind by 100 Gauss points; the last is a quarter period
        x, weights = np.polynomial.legendre.leggauss(100)
        share = ((u - u1) / max(u2 - u1, STEP)).clip(0, 1)
        amplitude = np.append(np.arcsin(np.copysign(np.sqrt(share), du)), np.pi / 2)[:, None] / 2
        integrals = (amplitude / np.sqrt(1 - modulus * np.sin(amplitude * (x + 1)) ** 2)) @ weights
        phase, quarter = integrals[:-1], integrals[-1]
        off = phase[1:] - phase[0] - speed * self.exact[:, TIME]
        off -= 2 * quarter * np.round(off / (2 * quarter))
        return np.abs(off * du[1:] / speed) + np.abs(u - u.clip(u1, u2))[1:]


# Truncation -----------------------------------------------------------------------------------


@dataclasses.dataclass
class Quotients:
    """Difference quotients over the steps before and after k: pairs of arrays (k, nb, 6).

    h: both steps [s], (k, 1, 1); of_poses: (r; log R^T R) over h; of_rates: (v; Omega) over h;
    turns (k, nb, 3): rotation vectors from k to its neighbours [rad]; rounding (k, 1): 64 eps / h.
    """

    h: tuple
    of_poses: tuple
    of_rates: tuple
    turns: tuple
    rounding: np.ndarray

    def average(self, pair):
        """Return the derivative at k of the parabola through both quotients."""
        before, after = pair
        h1, h2 = self.h
        return (h2 * before + h1 * after) / (h1 + h2)


def find_field(rates, Omega=ZERO, turned=ZERO):
    """Return fields (w; exp(turned)(hat(alpha) + hat(Omega)^2)) of velocity or acceleration.

    ``rates`` (..., 6) are w and alpha, of matter s: w + (...) s. ``turned`` [rad] brings fields of
    neighbouring steps, whose body frames differ, into one frame.
    """
    return rates[..., :3], exp(turned) @ (hat(rates[..., 3:]) + hat(Omega) @ hat(Omega))


def find_ratio(off, left, counted):
    """Return the summed errors over the summed bounds, of the worst body; 0 if undecided.

    off, left (k, nb): errors, and what the steps leave open; counted (k): mask of the steps that
    count. It is undecided if fewer than nine in ten count, or fewer than 3 of these are finite.
    """
    finite = counted & np.isfinite(off).all(1) & np.isfinite(left).all(1)
    if finite.sum() < 3 or counted.sum() < 0.9 * len(off):
        return 0.0
    off, left = off[finite].sum(0), left[finite].sum(0)
    return np.where(off > 0, off / left, 0).max()


def bound_errors(off, left, most):
    """Return errors and what is left open, both scaled down where an error is above ``most``.

    Two rates differ by at most twice the largest. An infinite error becomes ``most``, with nothing
    left open.
    """
    share = np.minimum(1, most / np.where(off > 0, off, most))
    infinite = np.isinf(off)
    bounded = np.where(infinite, most, np.minimum(off * share, most))
    return bounded, np.where(infinite, 0, np.minimum(left * share, most))


class TruncationLaw:
    """The law that rates follow from poses and the equations of motion, within the steps' errors.

    Limit: no ratio of errors to what the steps leave open is above 1 [Truncation].
    """

    def __init__(self, problem, states, reaction, speed, length):
        self.p = problem
        self.states = states
        self.reaction = reaction  # lambda (n, rows of joints), or None
        self.speed, self.length = speed, length  # scales [m/s], [m]
        self.slow = speed / np.ptp(
            states[:, TIME]
        )  # [m/s^2]: changes the speed by itself over the run
        self.size = np.abs(unpack_states(states).r).max() + problem.gyration.max()
        # [m]: loads (nb, 6) over it are forces, moments over the longest arm of the body's joints
        self.lever = np.repeat(np.stack([np.ones(problem.nb), problem.arm], 1), 3, 1)
        self.steps = self.list_inner_steps()
        self.every = np.ones(len(self.steps), bool)
        self.nothing = np.zeros((len(self.steps), problem.nb))

    def find_ratios(self):
        """Return the largest of three ratios, and the largest acceleration over the speed [1/s].

        The ratios are those of velocities, accelerations and reactions. Ratios above 1 are computed
        again, with wider bounds, and divided by those of the exact motion.
        """
        if len(self.steps) < 3 or not self.speed > 0:
            return 0.0, 0.0
        projected, a, load = self.find_answers(self.states, self.steps)
        velocities = self.judge_velocities(self.states, self.steps)
        accelerations, largest = self.judge_accelerations(
            self.states, self.steps, a, self.nothing, self.every
        )
        reactions = self.judge_reactions(load, self.nothing, self.every)
        fastest = largest[np.isfinite(largest)].max(initial=0) / self.speed
        if max(accelerations, reactions) > 1 or not np.isfinite(largest).all():
            accelerations, reactions = self.judge_with_wider_bounds(projected, a, load, largest)
        if max(velocities, accelerations) > 1:
            exact_velocities, exact_accelerations = self.judge_exact_motion()
            velocities /= max(1, 2 * exact_velocities)
            accelerations /= max(1, 2 * exact_accelerations)
        return max(velocities, accelerations, reactions), fastest

    def list_inner_steps(self):
        """Return up to 100 inner steps, evenly chosen where no body turns by 0.5 rad in a step.

        They are fewer for large systems: 2e8 numbers of A^T A take some seconds.
        """
        turning = norm(unpack_states(self.states).Omega).max(1)  # [rad/s]
        fastest = np.maximum(np.maximum(turning[:-2], turning[1:-1]), turning[2:])
        h = np.diff(self.states[:, TIME])
        resolved = fastest * np.maximum(h[:-1], h[1:]) < 0.5
        k = 1 + np.flatnonzero(resolved)
        rows = max(self.p.row_is_joint.sum(), 1)
        most = min(max(int(2e8 / (6 * self.p.nb * rows**2)), 4), 100, len(k))
        return k[np.unique(np.linspace(0, len(k) - 1, most).round().astype(int))]

    def find_answers(self, states, k):
        """Return the projected states at steps k, and accelerations and loads at k-1, k, k+1."""
        projected = [self.p.project(states[k + beside]) for beside in (-1, 0, 1)]
        answers = [self.p.accelerate(near) for near in projected]
        return projected[1], [a for a, _ in answers], [load for _, load in answers]

    def find_quotients(self, states, k):
        """Return the difference quotients of poses and rates over the steps before and after k."""
        b = unpack_states(states)
        rates = np.append(b.v, b.Omega, 2)
        h = np.diff(states[:, TIME])[:, None, None]
        h = h[k - 1], h[k]
        of_poses, of_rates = [], []
        for first, step in zip((k - 1, k), h, strict=True):
            last = first + 1
            turned = log(b.R[first].swapaxes(2, 3) @ b.R[last]).real
            of_poses.append(np.append(b.r[last] - b.r[first], turned, 2) / step)
            of_rates.append((rates[last] - rates[first]) / step)
        turns = -h[0] * of_poses[0][..., 3:], h[1] * of_poses[1][..., 3:]
        rounding = 64 * MACHINE_EPSILON / np.minimum(*h)[..., 0]
        return Quotients(h, of_poses, of_rates, turns, rounding)

    def find_difference(self, one, other):
        """Return how far two fields differ: (k, nb), as motion distances do."""
        return self.p.find_motion_distance(one[0] - other[0], one[1] - other[1])

    def judge_velocities(self, states, k):
        """Return the ratio of velocities: quotients of poses less (v; Omega) [m/s].

        Open: the difference of both quotients, 1 % of the speed scale, and rounding.
        """
        q, b = self.find_quotients(states, k), unpack_states(states)
        error = q.average(q.of_poses) - np.append(b.v, b.Omega, 2)[k]
        off = self.p.find_motion_distance(*find_field(error))
        before, after = (
            find_field(rates, ZERO, turned / 2)
            for rates, turned in zip(q.of_poses, q.turns, strict=True)
        )
        left = self.find_difference(before, after) + 0.01 * self.speed + self.size * q.rounding
        return find_ratio(off, left, np.ones(len(k), bool))

    def judge_accelerations(self, states, k, a, wider, counted):
        """Return the ratio of accelerations: quotients of (v; Omega) less a of [Equations].

        Open: how much a changes to both neighbours, or both quotients differ, 1 % of the largest,
        rounding, and ``wider`` (k, nb). Also the largest acceleration of each step (k, 1) [m/s^2].
        """
        q, b = self.find_quotients(states, k), unpack_states(states)
        Omega = b.Omega
        here = find_field(a[1], Omega[k])
        before = find_field(a[0], Omega[k - 1], q.turns[0])
        after = find_field(a[2], Omega[k + 1], q.turns[1])
        largest = np.maximum(self.p.find_motion_distance(*here).max(1, keepdims=True), self.slow)
        changes = self.find_difference(before, here) + self.find_difference(after, here)
        over_before, over_after = (
            find_field(rates, poses[..., 3:], turned / 2)
            for rates, poses, turned in zip(q.of_rates, q.of_poses, q.turns, strict=True)
        )
        left = np.maximum(changes, self.find_difference(over_before, over_after))
        error = q.average(q.of_rates) - a[1]
        off = self.p.find_motion_distance(*find_field(error))
        off, left = bound_errors(off, left, 2 * largest)
        fastest = self.p.find_motion_distance(*find_field(np.append(b.v, Omega, 2)[k])).max()
        left = left + 0.01 * largest + fastest * q.rounding + wider
        return find_ratio(off, left, counted), largest

    def judge_reactions(self, load, wider, counted):
        """Return the ratio of reactions: A^T lambda less the loads of the equations of motion [N].

        Open: how much either changes to both neighbours, 1 % of the largest, and ``wider``.
        """
        if self.reaction is None:
            return 0.0
        stated = [self.find_stated_loads(self.steps + beside) for beside in (-1, 0, 1)]
        exact = [one / self.lever for one in load]
        changes = [norm(one[1] - one[0]) + norm(one[2] - one[1]) for one in (stated, exact)]
        largest = self.find_largest_load(load[1])
        off, left = bound_errors(norm(stated[1] - exact[1]), np.maximum(*changes), 2 * largest)
        return find_ratio(off, left + 0.01 * largest + wider, counted)

    def find_stated_loads(self, k):
        """Return A^T lambda of the stated reactions at steps (k, nb, 6), over the lever."""
        A = self.p.differentiate(self.states[k])[:, self.p.row_is_joint]
        return np.einsum("tr,trbk->tbk", self.reaction[k], A) / self.lever

    def find_largest_load(self, load):
        """Return the largest load of each step (k, nb) [N], at least m speed / t_end."""
        return np.maximum(norm(load / self.lever).max(1, keepdims=True), self.p.mass * self.slow)

    def judge_with_wider_bounds(self, projected, a, load, largest):
        """Return the ratios of accelerations and reactions, with wider bounds.

        They are wider by ten times the change of accelerations and loads where poses are moved by
        their own error. Only steps count at which this change is at most a tenth of the largest
        value.
        """
        b, near = unpack_states(self.states), unpack_states(projected)
        k = self.steps
        own = self.p.find_motion_distance(b.r[k] - near.r, b.R[k] - near.R).max(1)
        own = np.fmin(np.fmax(own, 1e-9 * self.length), 1e-3 * self.length)  # of NaN the bound
        others = [self.p.accelerate(self.disturb(projected, own, seed)) for seed in (0, 1)]
        here = find_field(a[1], b.Omega[k])
        moved = np.max(
            [self.find_difference(find_field(other, b.Omega[k]), here) for other, _ in others], 0
        )
        counted = np.all(moved <= 0.1 * largest, 1)  # false where it is no number
        accelerations, _ = self.judge_accelerations(self.states, k, a, 10 * moved, counted)
        moved = np.max([norm((other - load[1]) / self.lever) for _, other in others], 0)
        counted = counted & np.all(moved <= 0.1 * self.find_largest_load(load[1]), 1)
        return accelerations, self.judge_reactions(load, 10 * moved, counted)

    def disturb(self, states, by, seed):
        """Return states moved at random by about ``by`` (k) [m], then projected again."""
        shift, turned = np.random.default_rng(seed).standard_normal((2, self.p.nb, 3))
        step = np.append(shift, turned / self.p.arm.max(), 1)
        return self.p.project(self.p.move(states, by[:, None, None] * step))

    def judge_exact_motion(self):
        """Return the ratios of velocities and accelerations of the exact motion at the same steps.

        Steps longer than half a period resolve not even the exact motion. Both ratios are 0 if
        fewer than half of the steps have exact states.
        """
        t, exact_t, k = self.states[:, TIME], self.p.exact[:, TIME], self.steps
        there = np.isin(t[k - 1], exact_t) & np.isin(t[k], exact_t) & np.isin(t[k + 1], exact_t)
        k = k[there]
        if len(k) < max(3, 0.5 * len(self.steps)):
            return 0.0, 0.0
        around = np.unique([k - 1, k, k + 1])
        exact = self.p.exact[np.isin(exact_t, t[around])]
        k = np.searchsorted(around, k)  # the same steps among those around them
        _, a, _ = self.find_answers(exact, k)
        every, nothing = self.every[: len(k)], self.nothing[: len(k)]
        accelerations, _ = self.judge_accelerations(exact, k, a, nothing, every)
        return self.judge_velocities(exact, k), accelerations


# A motion -------------------------------------------------------------------------------------


class Run:
    """The states of one run, and the laws by which its record follows from them."""

    def __init__(self, report, problem, run, record, states, rows):
        self.report, self.compare, self.require = report, report.compare, report.require
        self.require_equal = report.require_equal
        self.p, self.run, self.record, self.states, self.rows = problem, run, record, states, rows
        self.peaks = run["peaks_s"]  # times of maxima [s]
        self.t = states[:, TIME]
        self.bodies = unpack_states(states)
        self.finite = np.isfinite(states[:, :-1]).all(1)  # (n)
        self.has_every_step = run["states"] == "every step"
        self.has_exact_motion = len(problem.exact) > 0
        self.horizon_reaches_end = problem.horizon >= problem.t_end
        self.is_one_mechanism = len(problem.mechanisms) == 1
        self.is_whole = self.has_every_step or self.horizon_reaches_end  # its scales are complete
        self.stated_reasons = sorted(
            {reason["law"] for reason in json.loads(record["wrong_because"])}
        )
        self.first_breaks = {key: at for key, at in self.peaks.items() if ":first" in key}
        self.first_break = min(self.first_breaks.values(), default=np.inf)
        # sizes of the terms whose sums are rounded: of poses [m], of 1 for rotations
        self.pose_size = np.abs(self.bodies.r[self.finite]).max(initial=0) + problem.rim
        self.exact_t = self.t[:0]  # times of states that have their exact state
        self.every_step_has_exact = False  # up to the horizon

    def check(self):
        """Compare the record with every law, in the order in which the laws build on each other."""
        self.check_times()
        self.check_steps()
        if self.record["claimed"] == "success" and not self.finite.all():
            found = self.record["status"], self.stated_reasons
            self.compare("status and reason", ("wrong", ["finite"]), recorded=found)
            return
        self.set_scales()
        self.set_shares()
        self.check_scales()
        self.check_limits()
        self.check_trend()
        self.check_plane()
        self.measure_errors()
        series = self.list_series()
        self.check_maxima(series)
        self.check_errors_in_time()
        self.check_peaks(series)
        self.check_first_breaks()
        self.check_kinematics()
        self.check_instants()
        self.check_reaction()
        self.check_invariants()
        self.check_rows(series)
        self.check_status()

    def check_times(self):
        """Check the time of the last state, and that a success began at 0 [Times and steps]."""
        self.compare("t_reached_s", float(self.t[-1]), 0.0, self.has_every_step)
        if self.has_every_step and self.record["claimed"] == "success":
            starts = self.t[0] == 0 or "start" in self.stated_reasons
            self.require("time of the first state", starts, self.t[0], 0.0)

    def check_steps(self):
        """Check number and sizes of steps, and the fixed step that was requested [Times and steps].

        The smallest, median and largest step leave out the last one, which ends at t_end.
        """
        steps = np.diff(self.t)
        count = float(len(steps))
        self.compare("steps", count, 0.0, self.has_every_step)
        if not self.has_every_step:
            self.require("states", count != self.record["steps"], "some steps", "every step")
        if len(steps) > 1:
            steps = steps[:-1]
        known = self.has_every_step and len(steps) > 0
        slack = ROUNDING * self.t[-1]
        for name in ("min", "max", "median"):
            value = float(getattr(np, name)(steps)) if known else None
            self.compare(f"step_{name}_s", value, slack)
        self.compare("step_ratio", float(steps.max() / steps.min()) if known else None)
        if known and self.record["control"] == "dt":
            asked, median = self.record["dt_s"], np.median(steps)
            fits = STEP_ASKED[0] * asked <= median <= STEP_ASKED[1] * asked
            if self.record["status"] == "success" and self.record["suite"] != "refereed":
                self.require("dt_s", fits, asked, median)
            elif not fits:  # a refereed motion has the step that its user names
                self.report.note_weakness(
                    "without success whose steps are not the fixed step asked for"
                )

    def set_scales(self):
        """Set the series and the scales of the run and of each of its mechanisms [Scales].

        scales: recorded ones, which check_scales compares with those found; by_mechanism: list of
        (series, scales).
        """
        p, record = self.p, self.record
        about = self.states, self.first_break, self.is_whole
        self.series, self.found = p.find_scales(*about, p.all_bodies)
        self.speed_size = np.nanmax(p.find_speed(self.bodies.v, self.bodies.Omega)) + self.pose_size
        kinetic, energy = self.series["T"], self.series["E"]
        self.energy_size = np.nanmax(kinetic + np.abs(energy - kinetic))
        self.scales = dict(self.found)
        # as NumPy's numbers: a quotient by 0 is infinite and raises nothing
        self.scales["length"] = np.float64(record["length_scale_m"])
        self.scales["gap_rate"] = np.float64(record["speed_scale_m_per_s"])
        self.scales["energy"] = np.float64(record["energy_scale_J"])
        if self.horizon_reaches_end or not self.has_exact_motion:
            self.scales["gap"] = min(record["length_scale_m"], self.found["stretch"])
            self.scales["reach"] = record["length_scale_m"]
        self.by_mechanism = [(self.series, self.scales)]
        if not self.is_one_mechanism:
            self.by_mechanism = [p.find_scales(*about, part) for part in p.mechanisms]

    def set_shares(self):
        """Set the shares (n) of its limit that each law takes, of the worst mechanism [Limits].

        The work done on one mechanism of several is not stated: its energy has no share, and
        ``knows_energy`` is false. ``error_factor`` (nb) weighs the errors of a body: the length of
        the whole over that of its mechanism.
        """
        self.knows_shares = self.is_whole or not self.has_exact_motion
        self.knows_energy, self.error_factor = True, 1
        if not self.is_one_mechanism:
            self.knows_shares = self.has_every_step
            self.knows_energy = not self.p.has_work
            pairs = zip(self.p.mechanisms, self.by_mechanism, strict=True)
            length = self.record["length_scale_m"]
            self.error_factor = sum(part * length / scales["length"] for part, (_, scales) in pairs)
        self.shares = {law: np.zeros(len(self.t)) for law in self.p.laws}
        parts = [self.p.all_bodies] if self.is_one_mechanism else self.p.mechanisms
        for part, (series, scales) in zip(parts, self.by_mechanism, strict=True):
            for law, shares in self.shares.items():
                if law != "energy" or self.is_one_mechanism or not self.p.does_work(part):
                    share = np.abs(series[law]) / (LIMITS[law] * scales[law])
                    self.shares[law] = np.maximum(shares, share)

    def check_scales(self):
        """Check length [m], speed [m/s] and energy [J]: maxima of find_scales [Scales]."""
        found = self.found
        if self.has_exact_motion:
            times = [at for key, at in self.peaks.items() if "scale " in key]
            kept = (times or found["is rest"] or not self.is_whole) and np.isin(
                times, self.p.scale_states[:, TIME]
            ).all()
            self.require("scales kept", kept, times, "even times of exact states")
        elif found["is rest"] and self.record["claimed"] == "success":
            self.report.note_weakness("that stay at rest, where no exact motion says so")
        self.compare("energy_start_J", found["energy start"], ROUNDING * found["energy terms"])
        full = self.is_whole
        self.compare("length_scale_m", found["length"], 0.0, full)
        self.compare("speed_scale_m_per_s", found["gap_rate"], 0.0, full)
        # a difference of energies: 1e-9 where most of them is not exchanged
        self.compare("energy_scale_J", found["energy"], 1e-9 * found["energy terms"], full)

    def check_limits(self):
        """Check the limits of phi [m] and phi_dot [m/s]: 0.01 gap scale, 0.05 speed [Limits].

        There are limits where phi is the gap: of one mechanism without axis rows.
        """
        p = self.p
        same_as_gap = not (p.axes > 0).any() or not p.row_is_joint.any()
        are_stated = self.is_one_mechanism and not p.literal and same_as_gap
        for column, law in (("phi_limit_m", "gap"), ("phi_dot_limit_m_per_s", "gap_rate")):
            if are_stated:
                limit = LIMITS[law] * self.scales[law]
                self.compare(column, limit if self.knows_shares else None)
            else:
                self.require(column, np.isnan(self.record[column]), self.record[column], "nan")

    def check_trend(self):
        """Check the slope [W] and the means [J] of the energy error [Energy trend].

        Slope = sum w (t - tm)(e - em) / sum w (t - tm)^2 of least squares, w the mean of both steps
        beside t, tm and em the means with w. Means are trapezoidal over the first and the last
        quarter of the time.
        """
        t, error, span = self.t, self.series["energy"], np.ptp(self.t)
        known = self.has_every_step and len(t) > 2 and np.isfinite(error).all()
        slope, slack = None, 0.0
        if known:
            steps = np.diff(t)
            weight = (np.append(steps, 0) + np.insert(steps, 0, 0)) / 2
            off = t - (weight @ t) / weight.sum()
            weighted = weight * off
            slope = weighted @ (error - (weight @ error) / weight.sum()) / (weighted @ off)
            slack = ROUNDING * self.energy_size / span
        self.compare("energy_trend_W", slope, slack)
        for column, low, high in (
            ("energy_mean_first_quarter_J", t[0], t[0] + 0.25 * span),
            ("energy_mean_last_quarter_J", t[-1] - 0.25 * span, t[-1]),
        ):
            inside = (t >= low) & (t <= high)
            mean = None
            if known and inside.sum() > 1:
                mean = np.trapezoid(error[inside], t[inside]) / np.ptp(t[inside])
            self.compare(column, mean, ROUNDING * self.energy_size)

    def check_plane(self):
        """Check how far a planar motion leaves its plane: max |(r - r(0)).normal| [m] [Plane]."""
        stated = self.record["out_of_plane_max_m"]
        if self.p.normal is None:
            self.require("out_of_plane_max_m", np.isnan(stated), stated, "nan")
            return
        height = self.bodies.r @ self.p.normal  # (n, nb)
        self.out_of_plane = np.abs(height - height[0]).max(1)
        full = self.has_every_step or self.peaks.get("out_of_plane_max_m") in self.t
        known = self.has_every_step or self.t[0] == 0
        largest = self.out_of_plane.max() if known else None
        self.compare("out_of_plane_max_m", largest, ROUNDING * self.pose_size, full)

    def measure_errors(self):
        """Set the errors at the states that have an exact state, all (times) [Errors].

        position, velocity, angular velocity: |a - a*|; orientation: 2 asin(|R - R*| / sqrt 8);
        motion [m] and rate [m/s]: motion distances, of mechanisms by their own length. Each is the
        largest of all bodies.
        """
        if not self.has_exact_motion:
            return
        p = self.p
        self.exact_t, own, exact = np.intersect1d(self.t, p.exact[:, TIME], return_indices=True)
        self.exact_rows = own
        ours, exactly = unpack_states(self.states[own]), unpack_states(p.exact[exact])
        self.stated_error = p.exact[exact, STATED]
        covered = self.t <= p.covered_to
        self.every_step_has_exact = self.has_every_step and len(self.exact_t) == covered.sum()
        dr, dR = ours.r - exactly.r, ours.R - exactly.R
        dv, dOmega = ours.v - exactly.v, ours.Omega - exactly.Omega
        dW = hat(ours.Omega) - hat(exactly.Omega)
        self.position_error = norm(dr).max(1)
        sine = np.linalg.norm(dR, axis=(2, 3)).max(1) / np.sqrt(8)
        self.orientation_error = 2 * np.arcsin(sine.clip(0, 1))
        self.velocity_error = norm(dv).max(1)
        self.angular_velocity_error = norm(dOmega).max(1)
        self.motion_error = (p.find_motion_distance(dr, dR) * self.error_factor).max(1)
        self.rate_error = (p.find_motion_distance(dv, dW) * self.error_factor).max(1)

    def list_series(self):
        """Return by stem the series whose maxima are columns: times, values, size of terms.

        Values are None if they are unknown; the terms are those whose sums are rounded.
        """
        knows_errors = self.knows_shares or self.is_one_mechanism
        gap = self.shares.get("gap") if self.knows_shares else None
        energy = self.shares["energy"] if self.knows_shares and self.knows_energy else None
        least = LIMITS["energy"] * min(scales["energy"] for _, scales in self.by_mechanism)
        gap_rate = self.shares.get("gap_rate") if knows_errors else None
        series = {
            "phi": (self.t, self.series["phi"], self.pose_size),
            "phi_dot": (self.t, self.series["phi_dot"], self.speed_size),
            "energy_drift": (self.t, self.series["energy"], self.energy_size),
            "orthogonality": (self.t, self.series["orthogonality"], 1),
            "gap_share": (self.t, gap, 1e3),  # shares of limits: 1e-9 of one is rounding
            "gap_rate_share": (self.t, gap_rate, 1e3),
            "energy_share": (self.t, energy, 1e3 + self.energy_size / least),
        }
        if not self.has_exact_motion:
            return series
        at = self.exact_t
        spin_size = 1 + np.abs(self.bodies.Omega[self.finite]).max(initial=0)
        motion = self.motion_error if knows_errors else None
        rate = self.rate_error if knows_errors else None
        return series | {
            "position_error": (at, self.position_error, self.pose_size),
            "orientation_error": (at, self.orientation_error, 1e4),  # asin loses half the digits
            "velocity_error": (at, self.velocity_error, self.speed_size),
            "angular_velocity_error": (at, self.angular_velocity_error, spin_size),
            "motion_error": (at, motion, self.pose_size),
            "rate_error": (at, rate, self.speed_size),
            "reference_own_error": (at, self.stated_error, 1e-3 * self.pose_size),
        }

    def list_columns(self, stem, which):
        """List the columns of a stem in the record: ``phi_max``, ``motion_error_max_m``."""
        return [name for name in self.record if re.fullmatch(f"{stem}_{which}(_.*)?", name)]

    def check_maxima(self, series):
        """Check the largest, the largest judged and the last value of each series [Maxima]."""
        for stem, (at, values, size) in series.items():
            has_all = self.every_step_has_exact if at is self.exact_t else self.has_every_step
            for which, last in (
                ("max", np.inf),
                ("judged", self.record["judged_to_s"]),
                ("end", self.record["t_reached_s"]),
            ):
                span = at == last if which == "end" else at <= last
                if not span.any():
                    continue
                names = self.list_columns(stem, which)
                stated = len(names) == 1 or which not in STATED_MAXIMA[stem]
                self.require(f"{stem}_{which}", stated, names, "one column")
                for name in names:
                    value = None
                    if values is not None:
                        value = values[span].max() if which == "end" else np.abs(values[span]).max()
                    full = has_all or which == "end" or self.peaks.get(name) in at
                    self.compare(name, value, ROUNDING * size, full)

    def check_errors_in_time(self):
        """Check how long a run is compared, judged, and tracks the exact motion [s] [In time].

        It is judged while the stated error is below 1e-9 length, or below 1e-3 length and 100 times
        its value at a tenth of the time. It tracks the motion while the motion error is at most
        0.1, 0.01 or 0.001 length + stated error.
        """
        record, at = self.record, self.exact_t
        if not len(at):
            if self.has_every_step:
                for column in (
                    "compared_to_s",
                    "judged_to_s",
                    "motion_error_max_m",
                    "reference_horizon_s",
                ):
                    self.require(column, np.isnan(record[column]), record[column], "nan")
            return
        covered = self.t[self.t <= self.p.covered_to]
        self.compare("compared_to_s", float(covered[-1]), 0.0, self.has_every_step)
        owed = self.report.lossless and self.has_every_step
        has_all = self.every_step_has_exact or not owed
        self.require("exact states", has_all, len(at), len(covered))
        stated, length = self.stated_error, record["length_scale_m"]
        self.compare(
            "reference_own_error_m", stated.max(), 1e-15 * self.pose_size, self.every_step_has_exact
        )

        # of each step the last one up to a tenth of its time, but not the first of several
        tenth = np.searchsorted(at, at / 10, "right") - 1
        tenth = np.maximum(tenth, self.every_step_has_exact and len(at) > 1)
        limit = np.where(stated <= 100 * stated[tenth], 1e-3, 1e-9) * length
        self.judged_count = max(np.logical_and.accumulate(stated < limit).sum(), 1)
        judged_to = at[self.judged_count - 1]
        self.compare("judged_to_s", judged_to, 0, self.every_step_has_exact)

        known = self.every_step_has_exact and (self.knows_shares or self.is_one_mechanism)
        for column, level in ACCURATE.items():
            off = ~(self.motion_error <= level * length + stated)
            until = at[np.argmax(off)] if off.any() else at[-1]
            self.compare(column, float(until) if known else None)

    def check_peaks(self, series):
        """Check the stated time of each maximum, if every step is kept [Peaks].

        The series of Eq. (81), if stored, is added to ``series``.
        """
        if not self.has_every_step:
            return
        eq81 = self.rows.get("eq81_norm", ())
        if len(eq81) == len(self.t):
            series["eq81"] = self.t, eq81, 0.0
        for stem, (at, values, size) in series.items():
            if stem == "reference_own_error" or values is None or not len(at):
                continue
            if at is self.exact_t and not self.every_step_has_exact:
                continue  # the maximum may be at a step without its exact state
            self.check_peaks_of(stem, at, values, ROUNDING * size)
        self.check_times_of_errors()
        for name in INSTANTS:
            has_time = np.isfinite(self.record[name]) <= (name in self.peaks)
            self.require(f"time {name}", has_time, "none", "a time")

    def check_peaks_of(self, stem, at, values, slack):
        """Check that a series has its largest and its largest judged value at the stated times."""
        stated = [name for name, value in self.record.items() if is_number(value)]
        for name in sorted({*stated, *self.peaks}):
            if not re.fullmatch(f"{stem}_(max|judged)(_.*)?", name):
                continue
            last = self.record["judged_to_s"] if f"{stem}_judged" in name else np.inf
            most = np.abs(values[at <= last]).max(initial=0.0)
            there = at == self.peaks.get(name)
            value = float(np.abs(values[there]).max()) if there.any() else -1.0
            most = np.inf if np.isnan(most) else most
            self.compare(f"at its time: {name}", value, slack, recorded=most)

    def check_times_of_errors(self):
        """Check that times to which a run is compared, judged and accurate are among the peaks."""
        decided = len(self.exact_t) and self.every_step_has_exact
        for name in ("judged_to_s", "compared_to_s"):
            stated, found = self.peaks.get(name), self.record[name]
            self.require(f"time {name}", not decided or stated == found, stated, found)
        if not decided or not (self.knows_shares or self.is_one_mechanism):
            return
        for name in ACCURATE:
            stated, found = self.peaks.get(name), self.record[name]
            if name not in self.peaks and found == self.exact_t[-1]:
                found = None  # accurate to the end, so no time at which it was not
            self.require_equal(f"time {name}", stated, found)

    def check_first_breaks(self):
        """Check when each law was first broken, if every step is kept [First breaks].

        A claimed success that breaks a law is wrong, whichever steps are kept.
        """
        known = {f"{SHARE_COLUMNS[law]}:first" for law in self.p.laws}
        self.require(":first", set(self.first_breaks) <= known, sorted(self.first_breaks), known)
        if self.first_breaks and self.record["claimed"] == "success":
            status = self.record["status"]
            self.require_equal("status: a law is broken", status, "wrong")
        if not (self.has_every_step and self.knows_shares):
            return
        for law, shares in self.shares.items():
            name = f"{SHARE_COLUMNS[law]}:first"
            if law == "energy" and not self.knows_energy:
                kept = self.peaks.get(name) is None or self.peaks[name] in self.t
                self.require(name, kept, self.peaks.get(name), "the time of a step")
                continue
            broken = ~(shares <= 1)  # of NaN, too
            first = self.t[np.argmax(broken)] if broken.any() else None
            self.require_equal(name, self.peaks.get(name), first)

    def check_kinematics(self):
        """Check that poses follow velocities from step to step [Kinematic defect]. Limit 0.5."""
        known = self.has_every_step and len(self.t) > 1
        defect = self.find_defect(self.states) if known else None
        self.compare("kinematic_defect", defect, 1e-9, why="not every step is kept")

    def find_defect(self, states):
        """Return the fraction of the path by which poses and velocities disagree, worst body.

        It is the sum of distances of (r + h v, R exp(h Omega)) from the next pose, v and Omega
        means of both ends, over 0.01 length + the larger of the sums of distances of poses and of h
        speed.
        """
        b, h = unpack_states(states), np.diff(states[:, TIME])[:, None, None]
        distance = self.p.find_motion_distance
        shift = h * (b.v[1:] + b.v[:-1]) / 2
        turned = h * (b.Omega[1:] + b.Omega[:-1]) / 2
        off = distance(b.r[:-1] + shift - b.r[1:], b.R[:-1] @ exp(turned) - b.R[1:]).sum(0)
        of_poses = distance(b.r[1:] - b.r[:-1], b.R[1:] - b.R[:-1]).sum(0)
        of_rates = distance(shift, hat(turned)).sum(0)
        path = np.maximum(of_poses, of_rates)
        return (off / (path + 0.01 * self.record["length_scale_m"])).max()

    def find_exact_defect(self):
        """Return the defect of the exact motion at the same steps, if that of the run exceeds 0.5.

        The steps may then be too long. It is 0 if fewer than half of them are before the horizon.
        If not every step is kept, this is noted, and the value agrees with the stated reasons.
        """
        if not self.record["kinematic_defect"] > 0.5:
            return 0.0
        covered = self.t[self.t <= self.p.covered_to]
        exact = np.isin(self.p.exact[:, TIME], covered)
        if self.has_every_step and exact.sum() == len(covered):
            enough = len(covered) >= max(2, 0.5 * len(self.t))
            return self.find_defect(self.p.exact[exact]) if enough else 0.0
        self.report.note_undecided("law kinematic", "not every step is kept")
        return 0.0 if "kinematic" in self.stated_reasons else self.record["kinematic_defect"]

    def check_instants(self):
        """Check the error between steps, errors of reactions and their sizes [Instants]."""
        for column in INSTANTS:
            if column not in self.peaks:
                continue
            at = self.peaks[column]
            exact = self.p.exact[self.p.exact[:, TIME] == at]
            own = self.states[self.t == at]
            between = column == "motion_between_max_m"
            here = len(exact) and (between or len(own))
            wanted = "a time whose states are kept"
            self.require(f"states of {column}", here or not self.every_step_has_exact, at, wanted)
            if between:
                self.check_between(exact, at)
            else:
                self.check_load(column, exact, own)
        self.weaken_without_instants()

    def check_between(self, exact, at):
        """Check the error [m] at a time, of the motion interpolated by cubics between its steps."""
        value = None
        if len(exact) and (self.has_every_step or self.run["between"]):
            r, R = interpolate_pose(self.states, at)
            exactly = unpack_states(exact)
            value = self.p.find_motion_distance(r - exactly.r, R - exactly.R).max()
        self.compare("motion_between_max_m", value, ROUNDING * self.pose_size)

    def check_load(self, column, exact, own):
        """Check the largest force [N] or moment [N m] about C on a body, by joints.

        Sizes: of A^T lambda in the exact motion, moments at least force times arm. Errors: of the
        exact loads less A^T lambda of the run's reactions and pose.
        """
        p, is_error = self.p, column in REACTIONS
        if not len(exact) or p.has_user_forces or (is_error and not len(own)):
            self.compare(column, None)
            return
        load = p.accelerate(p.project(exact))[1]
        size = self.record[REACTIONS.get(column, column)]
        if is_error:
            there = column in self.run["reactions"]
            self.require("reactions", there, "none", f"those of {column}")
            if not there:
                return
            A = p.differentiate(own)[0][p.row_is_joint]  # (rows, nb, 6)
            load = load - np.tensordot(self.run["reactions"][column], A, 1)
        force, moment = norm(load[..., :3]), norm(load[..., 3:])
        if column == "moment_size_Nm":
            moment = np.maximum(moment, p.arm * force)
        value = moment if column.startswith("moment") else force
        self.compare(column, float(value.max()), 1e-6 * size)

    def weaken_without_instants(self):
        """Note a success without reactions or without a comparison between steps."""
        if self.record["claimed"] != "success":
            return
        if np.isnan(self.record["reaction_error_max_N"]) and self.p.row_is_joint.any():
            self.report.note_weakness("without reactions, whose errors cannot be judged")
        if np.isnan(self.record["motion_between_max_m"]) and self.has_exact_motion:
            self.report.note_weakness("without a comparison of the motion between steps")

    def check_reaction(self):
        """Check that reactions are those of the series, and none if cut short [Instants]."""
        of_series = self.rows.get("state_reaction")
        if of_series is None:
            lacks = self.report.lossless and np.isfinite(self.record["reaction_error_max_N"])
            self.require("reactions", not lacks, "an error", "none: no reactions")
            return
        if not self.record["claimed"]:
            expected = "none: steps kept until a run ended have no reactions"
            self.require("reactions", False, "reactions", expected)
        elif not np.isfinite(of_series).all():
            self.report.note_weakness("with reactions that are no numbers at some steps")
        if self.has_every_step:
            for column, reaction in self.run["reactions"].items():
                here = self.t == self.peaks.get(column)
                same = here.any() and np.array_equal(of_series[here][0], reaction, equal_nan=True)
                self.require("reactions", same, "another", "that of the series")

    def find_units(self):
        """Return the scale of each unit of an invariant [Invariants]."""
        scales = self.scales
        return {
            "J": scales["energy"],
            "m": scales["length"],
            "m/s": scales["gap_rate"],
            "rad/s": scales["gap_rate"] / scales["reach"],
            "kg m/s": scales["momentum"],
            "kg m2/s": scales["momentum"] * scales["reach"],
            "N m s": scales["momentum"] * scales["reach"],
        }

    def measure_quantity(self, about):
        """Return the values (n) of an invariant: a quantity along a direction [Invariants].

        momentum: sum m v [kg m/s]; angular momentum: sum r x m v + R J Omega [kg m2/s]; spin: R J
        Omega of a body; rate: Omega of a body in its frame [rad/s].
        """
        p, b = self.p, self.bodies
        momenta = b.v * p.mass[:, None]
        spins = np.einsum("tbij,bjk,tbk->tbi", b.R, p.inertia, b.Omega)
        fields = {
            "spin": spins,
            "momentum": momenta.sum(1)[:, None],
            "angular momentum": (np.cross(b.r, momenta) + spins).sum(1)[:, None],
        }
        values = fields.get(about["quantity"], b.Omega)  # (n, nb or 1, 3)
        return values[:, about.get("body", 0)] @ about["along"]

    def check_invariants(self):
        """Check that invariants are those of the problem, and drift as the states do [Invariants].

        Limit: 0.1 of the larger of the scale of the unit and the start.
        """
        described, drifts = self.p.invariants, json.loads(self.record["invariant_drifts"])
        self.drifts, self.breaks_invariant = drifts, False
        if described:
            same = set(drifts) == set(described)
            self.require("names of invariants", same, sorted(drifts), sorted(described))
        if not drifts:
            self.report.note_weakness("without invariants")
        elif not all("quantity" in described.get(name, {}) for name in drifts):
            self.report.note_weakness("with invariants that their problem does not describe")
        units = self.find_units()
        for name, drift in drifts.items():
            about = {"quantity": "", "along": ZERO, "unit": drift["unit"]} | described.get(name, {})
            self.require_equal(f"invariant {name}: unit", drift["unit"], about["unit"])
            scale = units.get(about["unit"], 0.0)
            self.check_drift(name, drift, about, scale)
            limit = 0.1 * max(scale, abs(float(drift["start"])))
            if limit != 0:  # else of a unit without a scale, from 0: nothing to compare with
                self.breaks_invariant |= not float(drift["max"]) <= limit

    def check_drift(self, name, drift, about, scale):
        """Check I(0), and the last and largest I - I(0), from states or else from the series.

        The series is used if the problem does not describe the invariant.
        """
        values = self.measure_quantity(about)
        known = bool(about["quantity"]) and self.t[0] == 0
        row = self.rows.get(f"inv_{name}")
        if not known and self.has_every_step and row is not None and len(row) == len(self.t):
            values = row + float(drift["start"])
            known = True
        reaches_end = self.t[-1] == self.record["t_reached_s"]
        slack = ROUNDING * max(np.nanmax(np.abs(values)), scale)
        start = values[0] if known else None
        end = values[-1] - values[0] if known and reaches_end else None
        most = np.abs(values - values[0]).max() if known else None
        for key, value, full in (
            ("start", start, True),
            ("end", end, True),
            ("max", most, self.has_every_step),
        ):
            recorded = float(drift[key])
            self.compare(f"invariant {name}: {key}", value, slack, full, recorded)

    def check_rows(self, series):
        """Check that the series of a lossless bundle are those of its states [Series]."""
        m, owed = self.series, self.has_every_step and self.report.lossless
        rows = self.rows if owed else {}
        known = {  # values, and the size of rounded terms
            "t": (self.t, 0.0),
            "energy": (m["E"], self.energy_size),
            "energy_error": (m["energy"], self.energy_size),
            "dt": (np.insert(np.diff(self.t), 0, np.nan), 0.0),
            "orthogonality": (m["orthogonality"], 1.0),
            "phi_norm": (m["phi"], self.pose_size),
            "phi_dot_norm": (m["phi_dot"], self.speed_size),
        }
        known |= {stem: series[stem][1:] for stem in EXACT_SERIES if stem in series}
        if self.p.normal is not None:
            known["out_of_plane"] = self.out_of_plane, self.pose_size
        names = {*known, "eq81_norm", *(f"inv_{name}" for name in self.drifts)}
        lacking = names - set(rows)
        self.require("series listed", not (owed and lacking), "none", sorted(lacking))
        other = {name for name, row in rows.items() if len(row) != len(self.t)}
        self.require("series lengths", not other, sorted(other), f"{len(self.t)} numbers")
        for name in set(known) & set(rows) - other:
            self.check_row(name, rows[name], known[name][0], ROUNDING * known[name][1])
        self.check_eq81(rows.get("eq81_norm"))
        self.check_observables(rows)

    def check_row(self, name, row, values, slack):
        """Check one series, as far as values are known: steps with an exact state come first."""
        finite = np.isfinite(values)
        if not finite.any():
            return
        off = np.abs(row[: len(values)] - values)[finite].max()
        allowed = slack + RELATIVE * np.abs(values[finite]).max()
        self.require(f"series {name}", off <= allowed, "other values", f"off by {off:.3g}")

    def check_eq81(self, row):
        """Check the columns of Eq. (81) against its series; no bundle has its formula."""
        most, end = (None, None) if row is None else (float(row.max()), float(row[-1]))
        self.compare("eq81_max_sqrtJ", most, why="Eq. (81) is not described")
        self.compare("eq81_end_sqrtJ", end, why="Eq. (81) is not described")

    def check_observables(self, rows):
        """Check the errors of observables, from their series obs_ and ref_."""
        for name, error in json.loads(self.record["observable_errors"]).items():
            own, exact = rows.get(f"obs_{name}"), rows.get(f"ref_{name}")
            most, end, slack = None, None, 0.0
            off = () if own is None or exact is None else np.abs(own - exact)[: len(self.exact_t)]
            if len(off):
                most, end = float(off.max()), float(off[-1])
                slack = ROUNDING * np.abs(exact[np.isfinite(exact)]).max(initial=0)
            for key, value in (("max", most), ("end", end)):
                recorded = float(error[key])
                what = f"observable {name}: {key}"
                self.compare(what, value, slack, recorded=recorded, why="observables are code")

    def list_limits(self):
        """Return value and limit of each law that a claimed success must keep [Status].

        What the bundle cannot decide is noted.
        """
        record = self.record
        length, speed = self.scales["length"], self.scales["gap_rate"]
        energy = self.scales["energy"]
        stated_error = record["reference_own_error_judged_m"]
        start = np.nan
        if self.t[0] == 0:
            start = np.abs(self.states - self.p.start)[0, 1:-1].max()
        elif self.has_every_step:
            start = np.inf
        drift = record["energy_drift_max_J"], LIMITS["energy"] * energy
        if not self.is_one_mechanism:
            drift = self.shares["energy"].max() if self.knows_shares else 0.0, 1.0
            if not (self.knows_shares and self.knows_energy):
                why = "the work of each mechanism is not stated"
                self.report.note_undecided(
                    "law energy", why if self.knows_shares else "not every step is kept"
                )
                drift = (np.inf, 1.0) if "energy" in self.stated_reasons else drift
        return {
            "end": (abs(record["t_reached_s"] - self.p.t_end), 1e-9 * max(self.p.t_end, 1)),
            "start": (start, 1e-9 * (1 + length + speed)),
            "energy": drift,
            "constraint": (record["gap_share_max"], 1.0),
            "constraint_rate": (record["gap_rate_share_max"], 1.0),
            "orthogonality": (record["orthogonality_max"], LIMITS["orthogonality"]),
            "reaction": (
                record["reaction_error_max_N"],
                10 * (record["reaction_size_N"] + energy / length),
            ),
            "moment": (record["moment_error_max_Nm"], 10 * (record["moment_size_Nm"] + energy)),
            "kinematic": (record["kinematic_defect"] - self.find_exact_defect(), 0.5),
            "velocity": (record["rate_error_judged_m_per_s"], speed),
            "motion": (record["motion_error_judged_m"], 0.1 * length + stated_error),
            "rows": (record["motion_between_max_m"], 0.5 * length + stated_error),
        }

    def find_broken(self, excesses):
        """Return the names of the broken laws, those of inaccuracy included [Status].

        A law is also broken by a limit that is NaN, or by NaN for a value that every run has.
        """
        has_gap = "gap" in self.p.laws and self.p.row_is_joint.any()
        stated = {"end", "energy", "orthogonality"} | ({"constraint"} if has_gap else set())
        stated |= {"motion", "velocity"} if len(self.exact_t) else set()
        broken = set()
        for law, (value, limit) in excesses.items():
            if not value <= limit and (law in stated or not np.isnan(value)):
                broken.add(law)
        if self.breaks_invariant:
            broken.add("invariant")
        if self.has_exact_motion and not broken & INACCURATE_LAWS and self.breaks_truncation():
            broken.add("truncation")
        if broken & {"motion", "velocity"}:
            broken.discard("rows")
        return broken

    def breaks_truncation(self):
        """Return whether rates disagree with poses or the equations of motion [Truncation].

        Where the bundle cannot decide it, this is noted and the record's own reasons are returned.
        """
        if self.p.has_user_forces or not self.has_every_step:
            why = "user forces are code" if self.p.has_user_forces else "not every step is kept"
            self.report.note_undecided("law truncation", why)
            return "truncation" in self.stated_reasons
        reaction = self.rows.get("state_reaction")
        speed, length = self.scales["gap_rate"], self.scales["length"]
        truncation = TruncationLaw(self.p, self.states, reaction, speed, length)
        if len(truncation.steps) < 3:
            self.report.note_undecided("law truncation", "under three steps turn by less than 0.5")
        ratio, fastest = truncation.find_ratios()
        return max(ratio, self.find_rate_ratio(fastest)) > 1

    def find_rate_ratio(self, fastest):
        """Return the largest rate error over the one that errors of poses allow [Truncation].

        Both are over the judged time. Allowed: 2 (motion error + stated error)(1/median step + the
        larger of the fastest turn and ``fastest`` [1/s]). A rate error up to 0.01 speed gives 0.
        """
        count = self.judged_count if len(self.exact_t) else 0
        if count < 2:
            return 0.0
        judged = slice(count)
        rate = self.rate_error[judged].max()
        if not rate > 0.01 * self.record["speed_scale_m_per_s"]:
            return 0.0
        error = 2 * (self.motion_error + self.stated_error)[judged].max()
        by_step = 1 / np.median(np.diff(self.exact_t[judged]))
        fastest_turn = norm(self.bodies.Omega[self.exact_rows[judged]]).max()
        return rate / error / (by_step + max(fastest_turn, fastest))

    def check_status(self):
        """Check status and reasons against the laws, by columns checked above [Status]."""
        record, p = self.record, self.p
        if record["claimed"] != "success":
            reaches_end = abs(self.t[-1] - p.t_end) <= 1e-9 * max(p.t_end, 1)
            if record["status"] not in JUDGED and reaches_end:
                self.report.note_weakness("called failures though their motion reaches the end")
            return
        if record["status"] == "success":
            turned = p.find_reversed_joints(self.states).sum()
            self.require_equal("joints turned over", turned, 0)
        excesses = self.list_limits()
        broken = self.find_broken(excesses)
        wrong = broken - INACCURATE_LAWS
        self.compare("status", "wrong" if wrong else "inaccurate" if broken else "success")
        self.compare("wrong_because", sorted(wrong or broken), recorded=self.stated_reasons)
        decided = {"kinematic", "motion", "velocity", "rows", "reaction", "moment", "orthogonality"}
        if self.is_one_mechanism:
            decided.add("energy")
        for reason in json.loads(record["wrong_because"]):
            law = reason["law"]
            if law in decided:
                for key, value in zip(("value", "limit"), excesses[law], strict=True):
                    recorded = float(reason[key])
                    self.compare(f"reason {law}: {key}", float(value), recorded=recorded)


def is_number(value):
    """Return whether a column of a record is a number that is not NaN."""
    return isinstance(value, (int, float)) and not np.isnan(value)


# The report -----------------------------------------------------------------------------------


class Report:
    """The comparisons in a bundle: findings (disagreements), undecided (why, what), weak, lacking.

    ``numbers`` counts comparisons. An exception means that the file is no bundle. ``complete``
    requires of any bundle what a lossless one must have.
    """

    def __init__(self, path, complete=False):
        self.numbers, self.findings, self.undecided = 0, [], []
        self.weak = []  # words, one for each run with weaker evidence than others
        self.lacking = []  # words on runs of a suite that the bundle lacks
        self.label, self.record = "bundle", {}  # bundle, run or problem of the next comparisons
        files = read_files(path)
        head, records = files["bundle.json"], files["records.json"]
        runs, table = files["runs.json"], files["table.json"]
        self.runs = len(runs)
        self.check_format(head, runs, records)
        self.lossless = head["lossless"] is True
        self.complete = complete or self.lossless
        self.check_head(head, files, runs, records)
        self.check_suites(files, records)
        self.check_table(table, records)
        problems = self.read_problems(files, runs)
        by_id = {record["run_id"]: record for record in records}
        for run in runs:
            self.check_run(
                run, by_id[run["run_id"]], problems.get(run["problem"]), files, head["codes"]
            )

    def check_format(self, head, runs, records):
        """Refuse other formats and versions, and runs without exactly one record each [Files]."""
        right = head["format"] == "mbsbench bundle" and head["version"] == VERSION
        refuse_unless(right, "not a bundle of version 5")
        recorded = {record["run_id"] for record in records}
        described = {run["run_id"] for run in runs}
        paired = len(runs) == len(recorded) == len(records) and recorded == described
        refuse_unless(paired, "a run twice, or without a record")

    def read_problems(self, files, runs):
        """Return the problems of the runs by id, after checking each by itself."""
        keys = sorted({str(run["problem"]) for run in runs if run["problem"]})
        problems = {}
        for key in keys:
            problems[key] = Problem(
                files[f"problems/{key}.json"], files.get(f"references/{key}.npy"), key
            )
        for key in keys:
            self.label = key
            self.check_problem(problems[key], files[f"problems/{key}.json"])
            if len(problems[key].exact):
                self.check_reference(problems[key])
        return problems

    def check_run(self, run, record, problem, files, codes):
        """Check one record, and its motion if its states are kept."""
        self.label = record["run_id"]
        words = ("nan", "inf", "-inf")  # numbers that JSON does not have
        self.record = {name: float(x) if x in words else x for name, x in record.items()}
        self.check_record(run, codes)
        if problem is not None:
            self.check_names(problem, files[f"problems/{run['problem']}.json"])
        if self.check_evidence(run, problem):
            rows = self.read_rows(run, files)
            states = files[f"runs/{self.label}.npy"]
            sound = states.shape[1:] == problem.start.shape[1:] and len(states)
            refuse_unless(sound, f"runs/{self.label}.npy: no states of its problem")
            Run(self, problem, run, self.record, states, rows).check()

    def compare(
        self, column, value, slack=0.0, full=True, recorded=None, why="its states are not kept"
    ):
        """Compare a recorded value with the computed one, and note a disagreement.

        Floats agree within 1e-6 of the recorded one + slack; a NaN that is computed is infinite.
        ``None``, where nothing can be computed, is noted as undecided, with ``why``. Where ``full``
        is false, a computed value is a lower bound.
        """
        recorded = self.record[column] if recorded is None else recorded
        if isinstance(value, float):
            value = np.inf if np.isnan(value) else value
            recorded = float(recorded)
            allowed = RELATIVE * abs(recorded) + slack
            same = value == recorded or abs(value - recorded) <= allowed < np.inf
        else:
            same = value == recorded
        if value is None:
            self.note_undecided(column, why)
        elif not same and not full and value <= recorded:
            self.note_undecided(column, "only a lower bound")
        else:
            self.require(column, same, recorded, value)

    def require(self, what, holds, stated, found):
        """Count a comparison; note what is stated and what is found or expected unless it holds."""
        self.numbers += 1
        if not holds:
            line = f"{self.label:17} {what[:38]:38} {str(stated)[:48]:>24} {str(found)[:48]:>24}"
            self.findings.append(line)

    def require_equal(self, what, stated, found):
        """Count a comparison; note a disagreement unless ``stated`` equals ``found``."""
        self.require(what, stated == found, stated, found)

    def note_undecided(self, what, why):
        """Note something that the bundle cannot decide, and why."""
        self.undecided.append((why, what))

    def note_weakness(self, words):
        """Note that the evidence for this run is weaker than for others."""
        self.weak.append(words)

    def check_head(self, head, files, runs, records):
        """Check lossless, codes, and that the files are exactly those of the runs [Files]."""
        stated = head["lossless"]
        owed = stated is True or (stated is False and not self.complete)
        self.require("lossless", owed, stated, "true, or false where not all is owed")
        codes = sorted({str(record["code"]) for record in records})
        self.require_equal("codes", head["codes"], codes)

        moving = {run["run_id"] for run in runs if run["states"] != "none"}
        claimed = {record["run_id"] for record in records if claims_success(record)}
        has_evidence = not claimed or claimed & moving
        self.require("evidence", has_evidence, "no state of any success", "states")

        wanted = {f"runs/{run_id}.npy" for run_id in moving}
        for run in runs:
            if run["problem"]:
                wanted.add(f"problems/{run['problem']}.json")
                if self.lossless:
                    wanted.add(f"series/{run['run_id']}.npy")
        have = {name for name in files if name.startswith(("runs/", "series/", "problems/"))}
        self.require("files", have == wanted, sorted(have - wanted)[:1], sorted(wanted - have)[:1])
        lone = set()
        for name in files:
            problem = f"problems/{name.removeprefix('references/').removesuffix('.npy')}.json"
            if name.startswith("references/") and problem not in wanted:
                lone.add(name)
        self.require("references", not lone, sorted(lone)[:1], "a problem")

    def check_suites(self, files, records):
        """Check that suites are TOML; count their runs that the bundle lacks [Files]."""
        for name in files:
            if name.endswith(".toml"):
                try:
                    suite = tomllib.loads(files[name].decode())
                    self.require(name, isinstance(suite.get("name", ""), str), "its name", "text")
                except (ValueError, RecursionError):
                    self.require(name, False, "no TOML", "a suite")
        environments = {}
        for name in files:
            match = re.fullmatch(r"environment\.(.*)\.json", name)
            if match:
                environments[match[1]] = files[name]
        for suite in sorted({str(record["suite"]) for record in records}):
            own = [record for record in records if record["suite"] == suite]
            sizes = [
                environments.get(record["environment"], {}).get("suite_runs") for record in own
            ]
            most = max((size for size in sizes if isinstance(size, int)), default=0)
            if most > len(own):
                missing = f"{most - len(own)} of {most} runs of the suite {suite!r} are not here"
                self.lacking.append(missing)
        for record in records:
            if record["environment"] not in environments:
                self.note_weakness("without the packages and the machine of their run")

    def check_table(self, table, records):
        """Check every cell of the table [Table]."""
        keys = ("problem", "problem_parameters", "solver")
        groups = {}
        for record in records:
            groups.setdefault(tuple(record[key] for key in keys), []).append(record)
        stated = [tuple(row[key] for key in keys) for row in table]
        refuse_unless(stated == sorted(groups), "the table has other rows")
        for row in table:
            own = groups[tuple(row[key] for key in keys)]
            self.record, self.label = row, f"table {row['solver']}"[:17]
            cells = self.count_cells(own)
            for column, value in cells.items():
                self.compare(column, value)
            same = set(row) == {*cells, *keys}
            self.require("columns", same, sorted(row), "those of the page")

    def count_cells(self, records):
        """Return the cells of a row: counts, least motion error [m], least CPU time [s].

        The least CPU time is that of successes with an error of at most 1e-3 length.
        """
        statuses = [record["status"] for record in records]
        errors, times = [], []
        for record in records:
            error = float(record["motion_error_judged_m"])
            if record["status"] == "success" and error < np.inf:
                errors.append(error)
                if error <= 1e-3 * float(record["length_scale_m"]):
                    times.append(float(record["cpu_median_s"]))
        return {
            "success": statuses.count("success"),
            "inaccurate": statuses.count("inaccurate"),
            "wrong": statuses.count("wrong"),
            "least_cpu_s": min(times, default=np.inf),
            "runs": len(records),
            "least_motion_error_m": min(errors, default=np.inf),
        }

    def check_problem(self, p, data):
        """Check that names, user forces, gyrations, frame and plane fit the numbers [Numbers]."""
        self.require_equal("body_names", len(data["body_names"]), p.nb)
        joints = int(p.is_joint.sum())
        self.require_equal("joint_names", len(data["joint_names"]), joints)
        kinds = len(data["joint_kinds"])
        self.require_equal("joint_kinds", kinds, len(p.i))
        forces = [f"user force {k}" for k in range(p.user_count)]
        stated = data["not_serialised"]
        self.require_equal("not_serialised", stated, forces)
        least = np.sqrt(np.trace(p.inertia, axis1=1, axis2=2) / (2 * p.mass))
        enough = (p.gyration >= least * (1 - RELATIVE)).all()
        self.require("gyration", enough, p.gyration.min(), least.min())
        J = p.inertia
        least = np.linalg.eigvalsh(J).min(1) + ROUNDING * np.abs(J).max((1, 2))
        is_inertia = np.array_equal(J, transpose(J)) and (least >= 0).all()
        self.require("inertia", is_inertia, "no inertia", "symmetric, not below 0")
        self.require("joint_c", not (p.c[p.is_joint] != 0).any(), "of a joint", "of forces alone")
        frame = np.array(data["numbers"]["frame"], float)
        is_frame = frame.shape == (3, 3) and np.abs(frame.T @ frame - IDENTITY).max() < 1e-9
        self.require("frame", is_frame, "no rotation", "a rotation")
        is_unit = p.normal is None or abs(norm(p.normal) - 1) < 1e-9
        self.require("planar_normal", is_unit, "its length", 1)
        kind = data["reference"]["kind"]
        self.require(
            "reference: kind", kind in ("own", "certified", "computed", "none"), kind, "a kind"
        )
        self.require("reference: kind", kind != "none" or not len(p.exact), kind, "exact states")
        names = [about["name"] for about in data["invariants"]]
        self.require("invariants", len(set(names)) == len(names), names, "each once")
        for about in data["invariants"]:
            if "quantity" in about:
                known = about["quantity"] in QUANTITIES and abs(norm(about["along"]) - 1) < 1e-9
                body = about.get("body", 0)
                known = known and isinstance(body, int) and 0 <= body < p.nb
                self.require(f"invariant {about['name']}", known, about, "a quantity along a unit")

    def check_reference(self, p):
        """Check that the exact motion keeps the laws to its stated errors [Exact motion].

        Allowed: 1e-9 + 100 stated error / size of phi over size, phi_dot over the fastest rate,
        orthogonality, E - E(0) over the largest energy, if no work is done; and of a closed form.
        """
        t, stated = p.exact[:, TIME], p.exact[:, STATED]
        b, series = unpack_states(p.exact), p.measure_series(p.exact, p.all_bodies)
        size = np.abs(b.r).max() + p.rim
        speed = p.find_speed(b.v, b.Omega).max()
        sane = (
            (stated >= 0).all()
            and (stated < 0.1 * size).all()
            and t[0] >= 0
            and t[-1] <= p.covered_to
            and np.isfinite(p.exact).all()
        )
        self.require("reference: errors and horizon sane", bool(sane), True, False)

        allowed = 1e-9 + 100 * stated.clip(0) / size
        laws = {
            "phi": series["phi"] / size,
            "phi_dot": series["phi_dot"] / max(speed, 1e-9 * size),
            "orthogonality": series["orthogonality"],
            "energy": None,
            "start": None,
        }
        if not p.has_work:
            energy, kinetic = series["E"], series["T"]
            largest = kinetic.max() + np.abs(energy - kinetic).max() + 1e-300  # not 0 of rest
            laws["energy"] = (energy - p.measure_series(p.start, p.all_bodies)["E"]) / largest
        if t[0] == 0:
            off = np.abs(p.exact - p.start)[0, 1:-1].max() / (1e-9 * (1 + size + speed))
            laws["start"] = allowed * off  # whatever the stated error is
        if "Lagrange's top" in p.route:
            laws["closed form"] = allowed * p.find_top_error() / (RELATIVE + 2 * stated / size)
        elif "proved" in p.route:
            self.note_undecided("reference", "no closed form here: others prove its motion")
        for law, defect in laws.items():
            worst = None if defect is None else float(np.abs(defect / allowed).max())
            why = "work is done, or no exact start is kept"
            self.compare(f"reference: {law} / allowed", worst, 1, True, 0.0, why)

    def check_record(self, run, codes):
        """Check schema, code, and that either a step or a tolerance was requested [Record]."""
        record = self.record
        self.require_equal("schema", record["schema"], SCHEMA)
        self.require("code", record["code"] in codes, record["code"], codes)
        has_step, has_tolerance = record["dt_s"] > 0, record["rtol"] > 0
        asked = "dt" if has_step else "rtol"
        sound = has_step != has_tolerance and record["control"] == asked
        self.require("control", sound, record["control"], asked)
        self.check_ending(run)
        self.check_costs()

    def check_ending(self, run):
        """Check that status, claim of the solver and cause of the end are consistent [Ending]."""
        record = self.record
        status, claimed, ended_by = record["status"], record["claimed"], record["ended_by"]
        if claimed:
            self.check_claimed_ending(status, claimed, ended_by)
        else:
            self.check_cut_short(status, ended_by)
        if status == "refused":
            nothing = (
                record["steps"] == 0
                and np.isnan(record["t_reached_s"])
                and run["states"] == "none"
                and not record["series"]
            )
            self.require("refused", nothing, "a motion", "none")
        package = record["missing_package"]
        self.require("missing_package", status == "refused" or not package, package, "none")
        has_reasons = status in ("inaccurate", "wrong") and claimed == "success"
        reasons, expected = record["wrong_because"], "reasons" if has_reasons else "none"
        self.require("wrong_because", (reasons != "[]") == has_reasons, reasons, expected)

    def check_cut_short(self, status, ended_by):
        """Check the record of a solver that never returned, so that it claims nothing."""
        wanted = "crashed"
        if ended_by == "memory_limit":
            wanted = "memory"
        elif ended_by in UNFINISHED:
            wanted = "unfinished"
        self.require_equal("status", status, wanted)
        ended = ended_by not in ("", "solver")
        self.require("ended_by", ended, ended_by, "what ended a solver that claims nothing")
        counters = self.record["counters"]
        self.require("counters", counters == "{}", counters, "none: its solver claims nothing")

    def check_claimed_ending(self, status, claimed, ended_by):
        """Check the record of a solver that returned and claimed success or a failure."""
        wanted, enders = JUDGED if claimed == "success" else {claimed}, {"solver"}
        if claimed == "stalled":
            enders = (
                {"cpu_limit", "suspended"} if status == "unfinished" else {"solver", "suspended"}
            )
            wanted = {"stalled", "unfinished"}
        self.require("status", status in wanted, status, f"that of {claimed}")
        self.require("ended_by", ended_by in enders, ended_by, enders)
        codes = self.record["signal"], self.record["exit_code"]
        self.require("signal and exit_code", codes == (0, 0), codes, 0)

    def check_costs(self):
        """Check costs: none below 0, CPU times in order, none above that of the process [Costs].

        The CPU times of a submission are of repeated processes, of which only one is recorded.
        """
        record = self.record
        for column in COSTS:
            self.require(column, not record[column] < 0, record[column], "at least 0")
        ordered = [record[f"cpu_{name}_s"] for name in ("min", "q1", "median", "q3", "max")]
        known = [time for time in ordered if not np.isnan(time)]
        expected = "min, q1, median, q3, max"
        self.require("order of CPU times", known == sorted(known), ordered, expected)
        self.require("number of CPU times", len(known) in (0, 3, 5), ordered, "all or none")
        process, code = record["cpu_process_s"], record["code_s"]
        if known and not np.isnan(process):
            elsewhere = record["suite"] == "ladder" or '"CPU times: ' in str(record["notes"])
            longest = known[-1]
            self.require("cpu_process_s", elsewhere or longest <= process + CLOCK, process, longest)
            self.require("code_s", not code > process + CLOCK, code, process)
        if record["claimed"] == "success" and record["status"] in JUDGED:
            self.require(
                "repeats", record["repeats"] > 0 or not known, record["repeats"], "at least 1"
            )

    def check_names(self, p, data):
        """Check what the record states of its problem against the problem [Record]."""
        record = self.record
        parameters = json.loads(record["problem_parameters"])
        self.require_equal("problem", record["problem"], data["problem"])
        stated = data["parameters"]
        self.require_equal("problem_parameters", parameters, stated)
        self.require_equal("section", record["section"], data["section"])
        self.compare("t_end_s", p.t_end)
        literal, stated = bool(parameters.get("literal_start")), data["literal_start"]
        self.require("literal_start", stated is literal, stated, literal)
        self.require_equal("reference", record["reference"], p.route)
        horizon, stated = float(data["reference"]["horizon_s"]), record["reference_horizon_s"]
        same = horizon == stated or (np.isnan(horizon) and np.isnan(stated))
        self.require("reference_horizon_s", same, stated, horizon)
        if record["claimed"] == "success":
            if literal:
                self.note_weakness("that start as printed, whose joints nobody judges")
            if p.has_user_forces:
                self.note_weakness(
                    "with user forces, which are code: work, reactions and truncation are as stated"
                )
            if not len(p.exact):
                self.note_weakness("without an exact motion")

    def check_evidence(self, run, problem):
        """Check that a claimed success has its states [Evidence].

        Return whether the motion of the run can be checked.
        """
        states = run["states"]
        allowed = ("none", "some steps", "every step")
        self.require("states", states in allowed, states, "none, some or every")
        has_problem = bool(run["problem"]) or states == "none"
        self.require("problem", has_problem, "states", "of a problem")
        if claims_success(self.record):
            if self.complete:
                self.require_equal("evidence", states, "every step")
            elif states == "none":
                self.note_weakness("that claim success without a state")
            elif states != "every step":
                self.note_weakness("that claim success with the states of some steps")
        if states == "none":
            self.note_undecided("run", "no motion, or too large a state")
        return states != "none" and problem is not None

    def read_rows(self, run, files):
        """Return the series of a run by name [Evidence].

        Refuse those that do not fill their file in order.
        """
        arrays = run["arrays"]
        if not self.lossless:
            self.require("arrays", arrays == {}, sorted(arrays), "none")
            return {}
        vector = files[f"series/{self.label}.npy"]
        rows, at = {}, 0
        for name, (offset, shape) in sorted(arrays.items(), key=lambda item: item[1][0]):
            end = at + int(np.prod(shape))
            in_place = offset == at and vector.ndim == 1 and end <= len(vector)
            refuse_unless(in_place, f"series of {self.label}: {name} is not in its place")
            rows[name] = vector[at:end].reshape(shape)
            at = end
        self.require_equal("series", at, len(vector))
        count, most = self.record["series_rows"], self.record["steps"] + 1
        self.require("series_rows", count <= most, count, most)
        return rows


def claims_success(record):
    """Return whether a record claims success, or has a status that only a claimed success has."""
    return record["claimed"] == "success" or record["status"] in JUDGED


def main(path, complete=False):
    """Check a bundle and print what disagrees, is missing or undecided; return the exit code."""
    np.seterr(all="ignore")
    try:
        report = Report(Path(path), complete)
    except Exception as error:  # whatever the file may cause
        print(escape(f"{path}: unreadable: {type(error).__name__}: {error}"[:400]))
        return 2
    counts = f"{report.runs} runs checked, {report.numbers} numbers compared"
    disagreements, undecided = len(report.findings), len(report.undecided)
    print(escape(f"{path}: {counts}, {disagreements} disagreements, {undecided} undecided"))
    for line in report.findings:
        print(escape(line))
    for words in report.lacking:
        print(escape(f"  {words}"))
    for words in sorted(set(report.weak)):
        print(escape(f"  {report.weak.count(words)} of {report.runs} {words}"))
    for why in sorted({why for why, _ in report.undecided}):
        columns = [column for cause, column in report.undecided if cause == why]
        each = " ".join(f"{column} {columns.count(column)}," for column in sorted(set(columns)))
        print(escape(f"  {why}: {each}"))
    return 1 if report.findings else 0


def escape(text):
    """Return text in printable ASCII, so that a bundle cannot control the terminal."""
    return text.encode("unicode_escape").decode()


if __name__ == "__main__":
    if hasattr(signal, "SIGPIPE"):  # a reader that has seen enough ends it without a word
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    paths = [word for word in sys.argv[1:] if word != COMPLETE]
    sys.exit(max((main(path, COMPLETE in sys.argv) for path in paths), default=2))
