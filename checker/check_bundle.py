"""Check bundles of results from docs/bundle.md alone: recompute what their records state.

    python check_bundle.py [--complete] BUNDLE.zip ...

Exit code 0: all numbers agree; 1: some disagree; 2: a bundle is unreadable. One file with NumPy
alone, which shares no code with mbsbench. Names in brackets are sections of docs/bundle.md.

From top to bottom, with that page beside it in the same order: rotations; files; rows of joints
and forces; ``Problem``, the mechanics of states; ``TruncationLaw``, by which rates follow from
poses; ``Run``, a function a law, as they build on each other; ``Report``, which compares.

Arrays: n states, nb bodies, nj joints (forces between bodies follow the joints), rows of phi.
"""

import hashlib
import io
import json
import re
import signal
import sys
import tomllib
import warnings
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np

# Limits of a file: generous for thousands of runs, and small for a computer.
NAMES = r"((runs|references|series)/[\w-]{1,64}\.npy|(problems/)?[\w.-]{1,64}\.(json|toml|txt))"
FILE_NAMES = re.compile(NAMES, re.ASCII)
MAX_FILES = 20_000
MAX_BYTES = 1 << 30  # 1 GiB, packed and unpacked
MAX_JSON_BYTES = 1 << 24  # of one JSON file
MAX_JSON_VALUES = 3_000_000  # of one JSON file, counted by its commas and brackets
MAX_BODIES = 2000  # dense matrices of A must fit into memory
VERSION, SCHEMA = 5, 3  # of the format of bundles, of records

# Differences allowed between numbers.
RELATIVE = 1e-6  # recorded from recomputed: other formulas of the same law, other libraries
ROUNDING = 1e-12  # of the terms that are added: some thousand roundings of 2e-16
STEP = 1e-30  # of complex steps: its square vanishes beside 1, its quotient is exact to rounding
CLOCK = 0.05  # [s] by which readings of two clocks may differ
EPSILON = np.finfo(float).eps

# What the laws allow, as shares of scales; the first two are laws of every motion.
LIMITS = {"energy": 0.1, "orthogonality": 1e-3, "gap": 0.01, "gap_rate": 0.05}
SCALES = {"energy": "energy", "orthogonality": "one", "gap": "gap", "gap_rate": "speed"}
SHARE_COLUMNS = {law: f"{law}_share_max" for law in LIMITS}  # of the largest share of each limit
SHARE_COLUMNS["orthogonality"] = "orthogonality_max"
INACCURATE_LAWS = {"motion", "velocity", "rows"}  # broken by inaccurate motions; others by wrong
STEP_ASKED = (0.6, 1.6)  # of dt_s: median step of a success; whole steps need not fit into t_end
SCALE_TIMES = 2000  # even intervals of the exact motion whose ends set scales
REST = 1e-6  # of the size of a mechanism: a smaller motion is rest
SLENDER = 1.01  # of the gyration of a rod, whose inertia about its axis is 0: it is raised by 0.5 %
PACE = 2  # times its fastest speed: the exact motion is known at some times alone
# largest ratio of truncation at steps that nobody knew, where it is below 1 at known ones
DRAWN = 2
# shares of the length up to which the motion is followed
ACCURATE = {"accurate_until_s": 0.1, "accurate_until_1pct_s": 0.01, "accurate_until_0p1pct_s": 1e-3}
# errors of reactions and the sizes they are compared with
REACTIONS = {"reaction_error_max_N": "reaction_size_N", "moment_error_max_Nm": "moment_size_Nm"}
UNITS = {  # of the quantities of invariants
    "momentum": ("kg m/s", "N s"),
    "angular momentum": ("kg m2/s", "N m s"),
    "spin": ("kg m2/s", "N m s"),
    "rate": ("rad/s", "1/s"),
}
INSTANTS = ("motion_between_max_m", *REACTIONS, *REACTIONS.values())  # each at a time of its own

# What solvers claim; statuses of a claimed success; what ended a run that claims nothing, and its
# status then; costs, of which CPU times are in the order of their names.
CLAIMS = ("", "success", "refused", "diverged", "step_underflow", "singular", "stalled")
JUDGED = ("success", "inaccurate", "wrong")
CRASHES = ("exception", "exit", "signal", "killed", "supervisor_lost", "workers_lost")
LIMITED = ("wall_limit", "cpu_limit", "code_limit", "total_limit", "measure_limit", "suspended")
ENDINGS = dict.fromkeys(CRASHES, "crashed") | dict.fromkeys(LIMITED, "unfinished")
ENDINGS["memory_limit"] = "memory"
CPU_TIMES = ["cpu_min_s", "cpu_q1_s", "cpu_median_s", "cpu_q3_s", "cpu_max_s"]
COSTS = [*CPU_TIMES, "cpu_call_s", "cpu_import_s", "cpu_refuses_s", "cpu_process_s", "setup_s"]
COSTS += ["code_s", "wall_s", "measure_s", "peak_memory_MB", "cpu_limit_s", "wall_limit_s"]
COSTS += ["memory_limit_MB", "repeats", "events", "steps"]
COMPLETE = "--complete"  # option: every success has all its states, whatever the bundle says

ZERO, IDENTITY = np.zeros(3), np.eye(3)
PERMUTATION = np.cross(IDENTITY[:, None], IDENTITY)  # epsilon_ijk: (w x s)_i = epsilon_ijk w_j s_k

# A state is a row of 2 + 18 nb numbers: t; r, R, v, Omega of each body; what is stated.
TIME, STATED, BODY_NUMBERS = 0, -1, 18
GROUND = np.concatenate([ZERO, IDENTITY.ravel(), ZERO, ZERO])  # r, R, v, Omega of body -1


# Rotations ------------------------------------------------------------------------------------


def dot(a, b):
    """Return the products a.b of vectors along the last axis."""
    return np.einsum("...k,...k", a, b)


def norm(a):
    """Return the lengths |a| of vectors along the last axis."""
    return np.linalg.norm(a, axis=-1)


def hat(w):
    """Return the matrices of w x s (..., 3, 3) for vectors w (..., 3)."""
    return np.einsum("ijk,...j->...ik", PERMUTATION, w)


def exp(w):
    """Return the rotations (..., 3, 3) by |w| [rad] about w (..., 3): Rodrigues' formula.

    1 + sin(a)/a W + (1-cos(a))/a^2 W^2 with a = |w|; ``np.sinc(x)`` is sin(pi x)/(pi x), never 0/0.
    """
    x = norm(w)[..., None, None] / np.pi
    W = hat(w)
    return IDENTITY + np.sinc(x) * W + np.sinc(x / 2) ** 2 / 2 * W @ W


def log(R, near=ZERO):
    """Return vectors theta (..., 3) with exp(theta) = U V^T, the rotation nearest to R = U S V^T.

    Of the vectors that differ by whole turns, theta is the one nearest to the vector ``near``.
    """
    U, _, V = np.linalg.svd(np.where(np.isfinite(R), R, 0))
    R = U @ V
    axial = (R - R.mT)[..., [2, 0, 1], [1, 2, 0]] / 2  # sin(a) times the axis
    cosine = (np.linalg.trace(R)[..., None] - 1) / 2
    # half a turn has no sine: near it the longest column of (R + R^T)/2 - cos(a) is along the axis,
    # of either sign, as its angle then is
    square = (R + R.mT) / 2 - cosine[..., None] * IDENTITY
    longest = np.argmax(np.linalg.diagonal(square), -1)[..., None, None]
    axis = np.where(cosine < -0.9, np.take_along_axis(square, longest, -1)[..., 0], axial)
    length = norm(axis)[..., None]
    axis = axis / np.where(length == 0, 1, length)
    angle = np.arctan2(dot(axial, axis)[..., None], cosine)
    turns = np.round((dot(near, axis)[..., None] - angle) / (2 * np.pi))
    return axis * (angle + 2 * np.pi * turns)


def unpack(states):
    """Return r, v (n, nb, 3), R (n, nb, 3, 3), Omega (n, nb, 3) in the body: views of states.

    The view ``rates`` (n, nb, 6) is v and Omega side by side.
    """
    nb = states.shape[1] // BODY_NUMBERS
    each = states[:, 1:-1].reshape(len(states), nb, BODY_NUMBERS)
    R = each[..., 3:12].reshape(*each.shape[:2], 3, 3)
    v, Omega, rates = each[..., 12:15], each[..., 15:], each[..., 12:]
    return SimpleNamespace(r=each[..., :3], R=R, v=v, Omega=Omega, rates=rates)


def interpolate_pose(states, t):
    """Return r (nb, 3) and R (nb, 3, 3) at a time between two states, by cubics [Instants].

    They interpolate r, and theta in R exp(theta). With x = (t - t0)/h their weights are x^2 (3 -
    2x) of the change, h x (1-x)^2 of the first rate, h x^2 (x-1) of the last. theta' = Omega +
    theta x Omega / 2 + c theta x (theta x Omega), c = (1 - a/2 cot(a/2)) / a^2 up to a = |theta| =
    pi, then 1/12.
    """
    times = states[:, TIME]
    k = min(max(np.searchsorted(times, t, "right") - 1, 0), len(states) - 2)
    both = unpack(states[k : k + 2])  # axis 0: the states before and after
    h = times[k + 1] - times[k]
    x = (t - times[k]) / h
    Omega = both.Omega
    theta = log(both.R[0].mT @ both.R[1], h / 2 * Omega.sum(0))
    a = norm(theta)[:, None]
    c = np.where((a > 1e-4) & (a < np.pi), (1 - a / 2 / np.tan(a / 2)) / a**2, 1 / 12)
    across = np.cross(theta, Omega[1])
    theta_rate = Omega[1] + across / 2 + c * np.cross(theta, across)
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
    """Return the members of a bundle by name, parsed once sizes and digests are checked [Files].

    Refuse anything but plain files of known names, and a manifest that does not list exactly these.
    """
    refuse_unless(path.is_file() and path.stat().st_size <= MAX_BYTES, "no file of at most 1 GiB")
    members = path.read_bytes().count(b"PK\1\2")  # it marks each
    refuse_unless(members <= MAX_FILES, "more than 20,000 members")
    archive = zipfile.ZipFile(path)
    unpacked = sum(member.file_size for member in archive.infolist())
    refuse_unless(unpacked <= MAX_BYTES, "more than 1 GiB unpacked")
    files = {}
    for member in archive.infolist():
        name = member.orig_filename
        plain = member.external_attr >> 28 in (0, 8)  # Unix mode: none stated, a regular file
        plain = plain and member.compress_type in (0, 8, 12)  # stored, deflate, bzip2
        plain = plain and FILE_NAMES.fullmatch(name) and name not in files
        refuse_unless(plain, f"unexpected, duplicate or special file {name[:80]!r}")
        files[name] = archive.open(member).read(member.file_size)

    listed = files.pop("manifest-sha256.txt").decode("ascii").splitlines()
    found = {f"{hashlib.sha256(raw).hexdigest()}  {name}" for name, raw in files.items()}
    wrong = sorted(set(listed) ^ found) or (["a line twice"] if len(listed) > len(files) else [])
    refuse_unless(not wrong, f"{wrong[:1]!r:.160} differs from the manifest")
    for name, raw in files.items():
        if name.endswith(".npy"):
            files[name] = parse_numbers(name, raw)
        elif name.endswith(".json"):
            files[name] = parse_json(name, raw)
    return files


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

    def read_object(pairs):
        refuse_unless(len(dict(pairs)) == len(pairs), "a key twice")
        return dict(pairs)

    return json.loads(raw, object_pairs_hook=read_object)


# Rows of phi ----------------------------------------------------------------------------------

# Each function of a kind gets the joints g at n states, in space, as ``Problem.place_joints`` makes
# them, and returns its rows (n, nj). Quantities are complex steps: a + i STEP a', with a' the rate.
# Vectors (n, nj, 3): u, w in body i; n1, n2, n3 in body j; x_i, x_j the joint's points r + R s;
# d = x_i - x_j. r, R: pairs of bodies i and j. f(t) (n, nj); length L (nj).


def find_angle(y, x, less):
    """Return atan2(y, x) - less [rad], wrapped to -pi .. pi, for complex steps y and x.

    Its rate is that of atan2: (x y' - y x') / (x^2 + y^2).
    """
    rate = (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2)
    difference = np.arctan2(y.real, x.real) + 1j * rate - less
    return difference - 2 * np.pi * np.round(difference.real / (2 * np.pi))


def find_slip(g, point):
    """Return i STEP (v_i - v_j), the velocities of the matter of both bodies at a point."""
    velocities = []
    for r, R in zip(g.r, g.R, strict=True):
        at_rest = R.real.mT @ (point - r).real[..., None]  # the point in the body frame
        velocities.append((r + (R @ at_rest)[..., 0]).imag)
    return 1j * (velocities[0] - velocities[1])


def list_line_rows(g):
    """Return the rows of lines: n_k.d = 0 [m]; the row of a distance is (d.d - L^2) / 2L."""
    distance = (dot(g.d, g.d) / g.length - g.length) / 2
    return [np.where(g.is_distance, distance, dot(g.n1, g.d)), dot(g.n2, g.d), dot(g.n3, g.d)]


def list_rolling_disc_rows(g):
    """Return n1.(x - x_j) = 0 [m], and rows whose rates are n2 and n3.(v_i - v_j) = 0 [m/s] at x.

    x = x_i - L unit(n1 - (n1.u) u) is the lowest point of the disc of radius L about u.
    """
    upward = g.n1 - dot(g.n1, g.u)[..., None] * g.u
    lowest = g.x_i - g.length[:, None] * upward / np.sqrt(dot(upward, upward))[..., None]
    slip = find_slip(g, lowest)
    return [dot(g.n1, lowest - g.x_j), dot(g.n2.real, slip), dot(g.n3.real, slip)]


def list_rack_and_pinion_rows(g):
    """Return the row L wrap(atan2(a.(e x u), e.u) - e.d / L) = 0 [m] with e = -n2, a = n1 x n2."""
    across, along = dot(np.cross(g.n1, g.n2), np.cross(g.u, g.n2)), -dot(g.n2, g.u)
    return [g.length * find_angle(across, along, -dot(g.n2, g.d) / g.length)]


def list_load_rows(g):
    """Return a row whose rate is the power of force f u at x_i and torque f w on body i [W].

    u and w turn with the body where L is 1, else they are fixed in space.
    """
    turns, f, R = g.length[:, None] > 0, g.f.real[..., None], g.R[0]
    by_force = dot(f * np.where(turns, g.u.real, g.own_u), g.x_i.imag)
    torque = f * np.where(turns, g.w.real, g.own_w)
    by_torque = np.sum(hat(torque) @ R.real * R.imag, (2, 3)) / 2  # R' = hat(omega) R
    return [1j * (by_force + by_torque)]


ROWS = {  # of each kind how many, and what they are; all are 0 but those of springs and loads
    "points": (3, lambda g: [g.d[..., 0], g.d[..., 1], g.d[..., 2]]),  # d [m]
    "lines": (3, list_line_rows),
    "axes": (3, lambda g: [dot(g.u, g.n1), dot(g.u, g.n2), dot(g.w, g.n2)]),  # [-]
    "driven position": (1, lambda g: [dot(g.n1, g.d) - g.f]),  # n1.d - f [m]
    "driven distance": (1, lambda g: [np.sqrt(dot(g.d, g.d)) - g.f]),  # |d| - f [m]
    # u.(n1 cos f + n2 sin f) [-]
    "driven angle": (1, lambda g: [dot(g.u, g.n1) * np.cos(g.f) + dot(g.u, g.n2) * np.sin(g.f)]),
    "spring": (1, lambda g: [np.sqrt(dot(g.d, g.d)) - g.length]),  # elongation |d| - L [m]
    # of rate u.(v_i - v_j) - f [m/s], both velocities at x_i
    "knife edge": (1, lambda g: [dot(g.u.real, find_slip(g, g.x_i)) - 1j * STEP * g.f.real]),
    "rolling disc": (3, list_rolling_disc_rows),
    "rack and pinion": (1, list_rack_and_pinion_rows),
    # turn wrap(atan2(u.n2, u.n1) - L) [rad]
    "torsion": (1, lambda g: [find_angle(dot(g.u, g.n2), dot(g.u, g.n1), g.length)]),
    "load": (1, list_load_rows),
}
FORCES = ("spring", "torsion", "load")  # beside the joints: no constraints
LONG = ("distance", "rolling disc", "rack and pinion")  # whose L is above 0
# kinds of moving rows that read u, and how many of n1, n2, n3 kinds read
U_KINDS = ("driven angle", "knife edge", "rolling disc", "rack and pinion", "torsion")
N_COUNTS = {"driven position": 1, "driven angle": 2, "rack and pinion": 2, "torsion": 2}
N_COUNTS["rolling disc"] = 3
PLACES = [(kind, k) for kind, (count, _) in ROWS.items() for k in range(count)]
HALF_TURN_PLACES = [PLACES.index(("axes", 2)), PLACES.index(("driven angle", 0))]  # 0 there, too
ANGLE_PLACES = [k for k, (kind, _) in enumerate(PLACES) if kind in ("axes", "driven angle")]


# A problem ------------------------------------------------------------------------------------

SHAPES = {  # of numbers: by bodies, user forces or joints, then axes of fixed size
    "gravity": (3,),
    **dict.fromkeys(("mass", "gyration"), ("body",)),
    **dict.fromkeys(("start_r", "start_v", "start_Omega"), ("body", 3)),
    **dict.fromkeys(("inertia", "start_R"), ("body", 3, 3)),
    **dict.fromkeys(("user_i", "user_j"), ("user",)),
    **dict.fromkeys(("joint_i", "joint_j", "joint_length", "joint_k", "joint_c"), ("joint",)),
    **dict.fromkeys(("joint_points", "joint_lines", "joint_axes", "joint_moving"), ("joint",)),
    **dict.fromkeys(("joint_s_i", "joint_s_j", "joint_u", "joint_w"), ("joint", 3)),
    "joint_n": ("joint", 3, 3),
    "joint_motion": ("joint", 7),
}


class Problem:
    """The numbers of a problem, its exact motion, and the mechanics of its states.

    Numbers have the names of [Numbers] without ``joint_``: mass (nb), i (nj), s_i (nj, 3), ...
    """

    def __init__(self, data, exact, name):
        self.read_numbers(data, name)
        self.place_rows()
        self.find_mechanisms()
        self.set_work(data)
        self.literal = bool(data["literal_start"])
        self.invariants = {about["name"]: about for about in data["invariants"]}
        has_gap = self.is_joint.any() and not self.literal
        self.laws = list(LIMITS) if has_gap else ["energy", "orthogonality"]
        self.read_exact(exact, data["reference"])

    def read_numbers(self, data, name):
        """Set every number as an attribute; refuse one not finite or of a wrong shape [Numbers]."""
        numbers, sizes = data["numbers"], {}  # how many bodies, user forces and joints
        for key, axes in SHAPES.items():
            values = np.array(numbers[key], float)
            if isinstance(axes[0], str):
                sizes.setdefault(axes[0], len(values))
            shape = tuple(sizes.get(axis, axis) for axis in axes)
            if 0 in shape:  # an empty list has lost its other axes
                values = values.reshape(shape)
            known = values.shape == shape and np.isfinite(values).all()
            if key in ("user_i", "user_j", "joint_i", "joint_j"):  # -1 is the ground
                known = known and np.isin(values, range(-1, sizes["body"])).all()
                values = values.astype(int) if known else values
            words = f"{name}: {key} is not finite, of shape {shape} or beyond the bodies"
            refuse_unless(known, words)
            setattr(self, key.removeprefix("joint_"), values)
        self.nb, self.user_count, nj = sizes["body"], sizes["user"], sizes["joint"]
        self.kinds, self.t_end = np.array(data["joint_kinds"], "U40"), float(data["t_end_s"])
        few = 0 < self.nb <= MAX_BODIES and max(sizes.values()) <= 50 * self.nb + 50
        positive = (self.mass > 0).all() and 0 < self.t_end < np.inf
        known = set(self.kinds[self.moving > 0]) <= set(ROWS) - {"points", "lines", "axes"}
        counts = np.isin([self.points, self.lines, self.axes, self.moving], range(4)).all()
        sound = few and positive and known and counts and len(self.kinds) == nj
        refuse_unless(sound, f"{name}: bodies, masses, joint_kinds or t_end_s")
        normal = numbers.get("planar_normal")
        self.normal = None if normal is None else np.array(normal, float).reshape(3)

    def place_rows(self):
        """Set the joint and the place in PLACES of each row, joint by joint, and masks [Rows]."""
        counts = {kind: self.moving * (self.kinds == kind) for kind in ROWS}
        counts |= {"points": self.points, "lines": self.lines, "axes": self.axes}
        has_row = np.array([counts[kind] > k for kind, k in PLACES])  # (places, nj)
        self.row_joint, self.row_place = np.nonzero(has_row.T)  # both (rows)
        self.row_kinds = {PLACES[place][0] for place in self.row_place}
        self.is_joint = ~np.isin(self.kinds, FORCES)  # (nj)
        self.row_is_joint = self.is_joint[self.row_joint]  # (rows), as the next two
        self.row_is_load = (self.kinds == "load")[self.row_joint]
        self.row_is_angle = np.isin(self.row_place, ANGLE_PLACES)

    def find_direction_errors(self):
        """Return how far directions that rows read are from unit vectors at right angles [Rows].

        They are u of axes and ``U_KINDS``; w of three axes, which is normal to u; the first of n1,
        n2, n3 that lines, axes or ``N_COUNTS`` read.
        """
        moves = self.moving > 0
        lines = np.where(self.kinds == "distance", 0, self.lines)
        count = [N_COUNTS.get(kind, 0) for kind in self.kinds] * moves
        count = np.max([lines, np.minimum(self.axes, 2), count], 0)
        read = np.arange(3) < count[:, None]  # (nj, 3)
        off_n = np.abs(self.n @ self.n.mT - IDENTITY)[read[:, None] & read[..., None]]
        has_u = (self.axes > 0) | (np.isin(self.kinds, U_KINDS) & moves)
        off_u = np.abs(dot(self.u, self.u) - 1)[has_u]
        w, u = self.w[self.axes > 2], self.u[self.axes > 2]
        off_w = np.maximum(np.abs(dot(w, w) - 1), np.abs(dot(u, w)))
        offs = {"joint_n": off_n, "joint_u": off_u, "joint_w": off_w}
        return {key: off.max(initial=0) for key, off in offs.items()}

    def set_work(self, data):
        """Set the mask (nj) of the joints and forces that do work, by numbers with effect [Energy].

        A damper has c and a row; drives, knife edges and loads have f and a row, loads also u or w.
        """
        a, w, p = self.motion[:, 4:].T
        has_f = (self.motion[:, :4] != 0).any(1) | ((a != 0) & ((w != 0) | (p != 0)))
        pushes = (self.u != 0).any(1) | (self.w != 0).any(1)
        is_drive = np.char.startswith(self.kinds, "driven") | (self.kinds == "knife edge")
        works = (is_drive | ((self.kinds == "load") & pushes)) & has_f
        works |= np.isin(self.kinds, ("spring", "torsion")) & (self.c != 0)
        self.works = works & (self.moving > 0)
        self.has_user_forces = bool(self.user_count or data["not_serialised"])
        self.has_work = bool(self.has_user_forces or self.works.any())

    def does_work(self, part):
        """Return whether work is done on the bodies in a mask ``part`` (nb) of a mechanism."""
        by_joints = touches(part, self.i, self.j) & self.works
        return bool(by_joints.any() or touches(part, self.user_i, self.user_j).any())

    def find_mechanisms(self):
        """Set the mechanisms, which joints and forces connect, held bodies and arms [Mechanisms].

        Masks (nb): mechanisms, held by the ground, is_loose: has a joint without point rows.
        joint_arm: |s| of a body's farthest joint; arm: the gyration if longer; arm_sum: sum of |s|;
        rim: of all [m].
        """
        ends = np.array([np.append(self.i, self.user_i), np.append(self.j, self.user_j)])
        bodies = np.arange(self.nb)
        group = bodies.copy()
        for i, j in ends.T:
            if i >= 0 and j >= 0:
                group[group == group[i]] = group[j]
        self.mechanisms = [group == number for number in np.unique(group)]
        self.all_bodies = np.ones(self.nb, bool)
        holds = np.append(self.is_joint | (self.kinds == "spring"), np.ones(self.user_count, bool))
        self.held = np.isin(bodies, ends[:, holds & (ends < 0).any(0)])

        body = np.append(self.i, self.j)  # of each end of each joint, -1 the ground
        arms = norm(np.append(self.s_i, self.s_j, 0)) * np.tile(self.is_joint, 2)
        farthest = np.zeros(self.nb + 1)  # the last is the ground
        np.maximum.at(farthest, body, arms)
        self.joint_arm = farthest[:-1]
        self.arm = np.maximum(self.gyration, self.joint_arm)
        self.arm_sum = np.bincount(body + 1, arms, self.nb + 1)[1:]  # the first is the ground
        self.is_loose = np.isin(bodies, body[np.tile(self.is_joint & (self.points < 1), 2)])
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
            sound = exact.shape[1:] == self.start.shape[1:] and len(exact) and self.horizon > 0
            refuse_unless(sound, "a reference without states of this problem, or without a horizon")
        self.covered_to = self.horizon * (1 + ROUNDING)  # [s] the last time that is within
        even = self.exact[:, TIME] / min(self.t_end, self.horizon) * SCALE_TIMES
        near = np.abs(even - np.round(even)) < 1e-7  # times are written to 16 digits
        sets_scales = near & (even <= SCALE_TIMES * (1 + ROUNDING))
        self.scale_states = np.append(self.start, self.exact[sets_scales], 0)

    def find_distance(self, dr, D):
        """Return sqrt(|dr|^2 + tr(D S D^T) / m), S = tr(J)/2 - J: (n, nb) [m or m/s] [Errors].

        It is the root mean square of dr + D s over the matter s of a body; D (n, nb, 3, 3).
        """
        S = np.linalg.trace(self.inertia)[:, None, None] * IDENTITY / 2 - self.inertia
        turned = np.einsum("tbij,bjk,tbik->tb", D, S, D) / self.mass
        return np.sqrt(dot(dr, dr) + np.maximum(turned, 0))

    def find_speed(self, rates):
        """Return sqrt(v^2 + Omega.J Omega / m) of each body (n, nb) [m/s]: T is m speed^2 / 2."""
        return self.find_distance(rates[..., :3], hat(rates[..., 3:]))

    def place_joints(self, states, velocities=None, ahead=0.0):
        """Return the joints in space, with the ground as one more body at rest.

        ``velocities`` and ``ahead`` are those of ``find_rows``; f is its parabola about the states.
        """
        ground = np.tile(GROUND, (len(states), 1))
        bodies = unpack(np.concatenate([states[:, :-1], ground, states[:, -1:]], 1))
        step = 1j * STEP
        g = SimpleNamespace(r=[], R=[], length=self.length, own_u=self.u, own_w=self.w)
        for end, body in enumerate((self.i, self.j)):  # index -1 is the ground
            v, Omega = bodies.v[:, body], bodies.Omega[:, body]
            if velocities is not None:
                v, Omega = velocities[end]
            g.r.append(bodies.r[:, body] + (ahead + step) * v)
            R = bodies.R[:, body] @ (IDENTITY + ahead * hat(Omega))
            g.R.append(R @ (IDENTITY + step * hat(Omega)))

        def turn(R, vectors):
            return np.einsum("tkij,kj->tki", R, vectors)

        g.x_i, g.x_j = g.r[0] + turn(g.R[0], self.s_i), g.r[1] + turn(g.R[1], self.s_j)
        g.d = g.x_i - g.x_j
        g.u, g.w = turn(g.R[0], self.u), turn(g.R[0], self.w)
        g.n1, g.n2, g.n3 = (turn(g.R[1], self.n[:, k]) for k in range(3))
        t, x = states[:, :1], ahead + step * (velocities is None)
        c0, c1, c2, c3, a, w, p = self.motion.T
        sine, cosine = a * np.sin(w * t + p), a * np.cos(w * t + p)
        f_rate = c1 + t * (2 * c2 + 3 * t * c3) + w * cosine
        f_curve = 2 * c2 + 6 * t * c3 - w**2 * sine
        g.f = c0 + t * (c1 + t * (c2 + t * c3)) + sine + x * f_rate + x**2 / 2 * f_curve
        g.is_distance = self.kinds == "distance"
        return g

    def find_rows(self, states, velocities=None, ahead=0.0):
        """Return phi, phi_dot, which gaps are half a turn off (n, rows), u.n1xn2 (n, nj) [Rows].

        Poses and times are moved forward by ``ahead`` [s]. The velocities are those of the states;
        or ((v_i, Omega_i), (v_j, Omega_j)) of every joint, with time held fixed.
        """
        pieces = len(states) * max(self.nb, len(self.i)) // 60_000 + 1  # of some 100 MB
        if 1 < pieces <= len(states):
            some = [self.find_rows(a, velocities, ahead) for a in np.array_split(states, pieces)]
            return [np.concatenate(parts) for parts in zip(*some, strict=True)]
        g = self.place_joints(states, velocities, ahead)
        nothing = np.zeros((len(states), len(self.kinds)))
        table = []  # by place: complex steps (n, nj)
        for kind, (count, list_rows) in ROWS.items():
            table += list_rows(g) if kind in self.row_kinds else [nothing] * count
        # axes of the table: place, state, joint; of its rows: row, state
        rows = np.array(table)[self.row_place, :, self.row_joint].T

        turned = dot(g.u, g.n2) * np.cos(g.f) - dot(g.u, g.n1) * np.sin(g.f)
        opposed = np.where(self.kinds == "driven angle", turned, -dot(g.w, g.n1)).real > 0
        half_turned = opposed[:, self.row_joint] & np.isin(self.row_place, HALF_TURN_PLACES)
        sides = dot(g.u.real, np.cross(g.n1.real, g.n2.real))
        return rows.real, rows.imag / STEP, half_turned, sides

    def find_reversed_joints(self, states):
        """Return the mask (nj) of joints whose u.n1xn2 has another sign than at the start [Gaps].

        Only two or three axis rows align u with n1 x n2.
        """
        start, sides = self.find_rows(self.start)[3], self.find_rows(states)[3]
        return (sides * start < 0).any(0) & (self.axes > 1)

    def measure_series(self, states, part):
        """Return the series (n) of the mechanism of the bodies in a mask ``part`` (nb), by name.

        Norms over rows [Gaps]: rows without unit count times the largest gyration; phi half a turn
        off counts 2 - |phi|. Reach [m], speed [m/s], momentum, energies [Scales]: E = sum (m v^2 +
        Omega.J Omega) / 2 - m gravity.r + sum k phi^2 / 2; T and V are its parts. All but E are of
        r and v from the common C where no joint holds the mechanism to the ground.
        """
        b, start = unpack(states), unpack(self.start)
        phi, phi_dot, half_turned, _ = self.find_rows(states)
        acts = touches(part, self.i, self.j)[self.row_joint]
        own = acts & self.row_is_joint
        metres = np.where(self.row_is_angle, self.gyration[part].max(), 1.0)
        gap = np.where(half_turned, 2 - np.abs(phi), phi) * metres

        mass = self.mass * part
        share = 0 * mass if (part & self.held).any() else mass / mass.sum()
        r, v, start_r = (a - (share @ a)[:, None] for a in (b.r, b.v, start.r))
        reach = self.find_distance(r - start_r, b.R - start.R)
        speed = self.find_speed(np.append(v, b.Omega, 2))
        orthogonality = np.linalg.matrix_norm(b.R.mT @ b.R - IDENTITY)
        elastic = phi**2 @ (acts * self.k[self.row_joint]) / 2
        return {
            "phi": norm(phi[:, own]),
            "phi_dot": norm(phi_dot[:, own]),
            "gap": norm(gap[:, own]),
            "gap_rate": norm((metres * phi_dot)[:, own]),
            "reach": reach[:, part].max(1),
            "speed": speed[:, part].max(1),
            "orthogonality": orthogonality[:, part].max(1),
            "momentum": speed @ mass,
            "elastic": elastic,
            "T": speed**2 @ mass / 2,
            "V": elastic + r @ -self.gravity @ mass,
            "E": self.find_speed(b.rates) ** 2 @ mass / 2 + b.r @ -self.gravity @ mass + elastic,
        }

    def find_scales(self, states, first_break, is_whole, part):
        """Return the series of a mechanism and its scales [Scales].

        They are maxima over the exact motion, and over steps beyond its horizon before the first
        break [s] of a law; or those of rest, if neither moves and the whole motion is known.
        """
        series = self.measure_series(states, part)
        exact = self.measure_series(self.scale_states, part)
        t = states[:, TIME]
        start = exact["E"][0] if t[0] else series["E"][0]
        series["energy"] = states[:, STATED] if self.does_work(part) else series["E"] - start
        beyond = t > self.covered_to
        rest = self.find_scales_at_rest(exact, part)
        moved = np.append(exact["reach"], series["reach"][beyond])
        if is_whole and not (moved > REST * rest["length"]).any():
            reach = self.measure_series(self.exact, part)["reach"]  # also where it sets no scale
            if not (reach > REST * rest["length"]).any():
                return series, rest | {"energy start": start, "is rest": True}

        late = beyond & (t < first_break)
        join = {key: np.append(exact[key], series[key][late]) for key in exact}
        gained = np.maximum(series["energy"][late], 0)  # an error, not energy to be exchanged
        T = np.append(exact["T"], series["T"][late] - gained)
        stretch = np.inf  # how far apart joints with points could be
        if not self.is_loose[part].any():
            stretch = 2 * (self.arm_sum[part].sum() + self.gyration[part].max())
        scales = {key: join[key].max() for key in ("reach", "speed", "momentum")}
        scales["length"] = exact["reach"].max() if len(self.exact) else scales["reach"]
        scales |= {"gap": min(scales["reach"], stretch), "stretch": stretch, "one": 1.0}
        scales["energy"] = max(T.max(), np.ptp(join["V"]))
        scales["energy terms"] = (T + np.abs(join["E"] - join["T"])).max()
        return series, scales | {"energy start": start, "is rest": False}

    def find_scales_at_rest(self, exact, part):
        """Return the scales of a mechanism that stays at rest, from its numbers alone [Scales].

        Length L: its longest arm of a joint, largest gyration or spread of the C's. Energy: T(0) +
        m g L + that of springs, at least m (1e-6 L)^2; speed: sqrt(2 energy / m).
        """
        spread = norm(np.ptp(self.start_r[part], 0))
        length = max(self.gyration[part].max(), spread, self.joint_arm[part].max())
        mass = self.mass[part].sum()
        speed = self.find_speed(unpack(self.start).rates)[0]
        kinetic = max(exact["T"][0], REST * (self.mass * part) @ speed**2 / 2)
        energy = kinetic + mass * norm(self.gravity) * length + exact["elastic"][0]
        energy = max(energy, mass * (1e-6 * length) ** 2)
        speed = np.sqrt(2 * energy / mass)
        scales = {"reach": length, "length": length, "gap": length, "stretch": np.inf, "one": 1.0}
        scales |= {"speed": speed, "momentum": mass * speed, "energy": energy}
        return scales | {"energy terms": energy + np.abs(exact["E"][0])}

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

        M a = f + A^T lambda, A a = drift. f: m gravity, -Omega x J Omega, -A^T (k phi + c phi_dot)
        of springs and torsions, A^T of loads. A^T lambda = M a - f [N] in space, [N m] in the body.
        """
        Omega = unpack(states).Omega
        phi, phi_dot, *_ = self.find_rows(states)
        A = self.differentiate(states)
        n, nb, size = len(states), self.nb, 6 * self.nb
        k, c = self.k[self.row_joint], self.c[self.row_joint]
        f = -np.einsum("tr,trbk->tbk", k * phi + c * phi_dot - self.row_is_load, A)
        f[..., :3] += self.mass[:, None] * self.gravity
        f[..., 3:] -= np.einsum("tbij,bjk,tbk->tbi", hat(Omega), self.inertia, Omega)

        M, bodies = np.zeros((nb, 6, nb, 6)), np.arange(nb)
        M[bodies, :3, bodies, :3] = self.mass[:, None, None] * IDENTITY
        M[bodies, 3:, bodies, 3:] = self.inertia
        M = np.tile(M.reshape(size, size), (n, 1, 1))
        A = A[:, self.row_is_joint].reshape(n, -1, size)
        # central difference of phi_dot along the motion, over 1e-5 of the fastest turn: errors of
        # its square and of rounding over it are both 1e-10 or so
        h = 1e-5 / max(1, np.abs(Omega).max())
        before, after = self.find_rows(states, ahead=-h)[1], self.find_rows(states, ahead=h)[1]
        drift = (before - after)[:, self.row_is_joint, None] / (2 * h)

        unit = self.mass.max()  # so that entries of M and A are comparable
        no_block = np.zeros((n, A.shape[1], A.shape[1]))
        matrix = np.block([[M / unit, A.mT], [A, no_block]])
        right = np.append(f.reshape(n, size, 1) / unit, drift, 1)
        # the pseudo-inverse: rows may be redundant, where a and the loads are unique all the same
        a = (np.linalg.pinv(matrix, 1e-12, hermitian=True) @ right)[:, :size]
        return a.reshape(f.shape), (M @ a).reshape(f.shape) - f

    def move(self, states, step, gained=0, later=0):
        """Return states with poses moved by step (n, nb, 6): [m] in space, [rad] in the body.

        Rates have gained (n, nb, 6), and times are ``later`` (n).
        """
        moved = states.copy()
        b = unpack(moved)  # views: what is written into them is written into ``moved``
        b.r[...] = b.r + step[..., :3]
        b.R[...] = b.R @ exp(step[..., 3:])
        b.rates[...] = b.rates + gained
        moved[:, TIME] += later
        return moved

    def follow(self, states, h, count):
        """Return states a time h (n) later, by ``count`` steps of the equations of motion.

        By Runge and Kutta's fourth order, of rates and of theta in R exp(theta): theta' = Omega +
        theta x Omega / 2 + theta x (theta x Omega) / 12.
        """
        h = h / count
        each = h[:, None, None]
        for _ in range(count):
            slope, gain = np.zeros((2, len(states), self.nb, 6))  # of poses and of rates
            slopes, gains = [], []  # at each stage
            for share in (0, 0.5, 0.5, 1):
                step = share * each * slope
                at = self.move(states, step, share * each * gain, share * h)
                slope, theta = unpack(at).rates.copy(), step[..., 3:]
                across = np.cross(theta, slope[..., 3:])
                slope[..., 3:] += across / 2 + np.cross(theta, across) / 12
                gain = self.accelerate(at)[0]
                slopes.append(slope)
                gains.append(gain)
            slope, gain = (np.average(all_, 0, [1, 2, 2, 1]) for all_ in (slopes, gains))
            states = self.move(states, each * slope, each * gain, h)
        return states

    def find_size(self):
        """Return how many numbers A^T A has, by which the work of the equations grows."""
        return 6 * self.nb * max(self.row_is_joint.sum(), 1) ** 2

    def compare_with_equations(self, first, last, count):
        """Return whether it is clear where the equations lead from states, and if not to others.

        ``change``: what the rates change by, a thousandth of them, since they may be constant, and
        rounding. The equations lead elsewhere if ``count`` steps of the fourth order end farther
        than a tenth of it from the next states. It is clear where half as many steps end as near as
        a hundredth of it; not for systems that take too long, nor for steps of over half a radian.
        """
        h = last[:, TIME] - first[:, TIME]
        turn = norm(unpack(first).Omega).max(initial=0) * h.max(initial=0)
        if self.find_size() > 2e6 or self.has_user_forces or not turn < count / 2:
            return False, False
        try:
            fine, coarse = self.follow(first, h, count), self.follow(first, h, count // 2)
        except np.linalg.LinAlgError:
            return False, False
        off, unclear, change, rates = (
            self.find_speed(unpack(fine).rates - unpack(others).rates).sum()
            for others in (last, coarse, first, 0 * first)
        )
        # rounding, which is all that a rest has: of poses over the time, of rates
        size = np.abs(self.exact[:, 1:-1]).max() + self.rim
        fastest = self.find_speed(unpack(self.exact).rates).max()
        floor = 1e-9 * (size / self.t_end + fastest + norm(self.gravity) * h.max())
        change += 1e-3 * rates + floor * len(h)
        is_clear = unclear <= 0.01 * change
        return bool(is_clear), bool(is_clear and off > 0.1 * change)

    def project(self, states):
        """Return states with the nearest poses on phi = 0, by mass and gyration [Truncation].

        Newton's steps y = A^+ phi of each state, with rows scaled to one, end when phi is rounding
        or no longer halves; a step that increases it is undone.
        """
        states = states.copy()
        if not self.row_is_joint.any():
            return states
        last = states.copy()
        by_axis = np.repeat(np.stack([np.ones(self.nb), self.gyration], 1), 3, 1)
        weight = np.sqrt(self.mass)[:, None] * by_axis  # (nb, 6)
        size = np.abs(unpack(states).r).max(initial=0) + self.arm.max()
        near = 64 * EPSILON * size
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
            row_length = np.where(norm(A) == 0, 1, norm(A))
            inverse = np.linalg.pinv(A / row_length[..., None], 1e-5)
            y = (inverse @ (phi / row_length)[..., None]).reshape(len(left), self.nb, 6)
            states[left] = self.move(states[left], -y / weight)
        return states

    def find_top_error(self):
        """Return the deviation of the exact motion from that of Lagrange's top [Exact motion].

        The cosine u to the vertical obeys u'^2 = d (u - u1)(u - u2)(u - u3), so u = u1 + (u2 - u1)
        sn^2 of a phase that grows with time. The deviation (n), without unit, is the error of the
        phase times u' over its speed, plus the distance of u from u1 .. u2.
        """
        top = unpack(np.append(self.start, self.exact, 0))  # the first is the start
        J, m, size, g = self.inertia[0], self.mass[0], norm(self.s_i[0]), norm(self.gravity)
        Omega = top.Omega[:, 0]
        arm = -self.s_i[0] / size  # from the fixed point to C, in the body
        up = -self.gravity / g @ top.R[:, 0]  # in the body
        J_axial = arm @ J @ arm
        J_pivot = (np.trace(J) - J_axial) / 2 + m * size**2  # across, about the fixed point
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


def touches(part, i, j):
    """Return the mask of pairs of bodies i and j, -1 the ground, of which ``part`` (nb) has one."""
    with_ground = np.append(part, False)
    return with_ground[i] | with_ground[j]


# Truncation -----------------------------------------------------------------------------------


def find_quotients(states, k):
    """Return quotients (k, nb, 6) of poses and of rates, turns to k's neighbours [rad], 64 eps / h.

    Quotients (r; log R^T R) / h and (v; Omega) / h are lists: of the step before k, of that after
    it, and of the parabola through both at k.
    """
    b = unpack(states)
    h, of_poses, of_rates, turns = [], [], [], []
    for first, sign in ((k - 1, -1), (k, 1)):
        last = first + 1
        h.append((states[last, TIME] - states[first, TIME])[:, None, None])
        turned = log(b.R[first].mT @ b.R[last])
        turns.append(sign * turned)
        of_poses.append(np.append(b.r[last] - b.r[first], turned, 2) / h[-1])
        of_rates.append((b.rates[last] - b.rates[first]) / h[-1])
    for pair in (of_poses, of_rates):
        pair.append((h[1] * pair[0] + h[0] * pair[1]) / (h[0] + h[1]))
    return of_poses, of_rates, turns, 64 * EPSILON / np.minimum(*h)[..., 0]


def find_field(rates, Omega=ZERO, turned=ZERO):
    """Return fields (w; exp(turned)(hat(alpha) + hat(Omega)^2)) of ``rates`` w and alpha (..., 6).

    ``turned`` [rad] brings fields of neighbouring steps, whose body frames differ, into one frame.
    """
    return rates[..., :3], exp(turned) @ (hat(rates[..., 3:]) + hat(Omega) @ hat(Omega))


def find_ratio(off, left, counted=True):
    """Return sum of errors / sum of bounds over steps (k, nb), of the worst body; -1 if undecided.

    It is undecided if fewer than nine in ten are ``counted``, or fewer than 3 of these are finite.
    """
    counted = counted & np.ones(len(off), bool)
    finite = counted & np.isfinite(off).all(1) & np.isfinite(left).all(1)
    if finite.sum() < 3 or counted.sum() < 0.9 * len(off):
        return -1.0
    off, left = off[finite].sum(0), left[finite].sum(0)
    ratio = np.where(off > 0, off / left, 0).max()
    return np.inf if np.isnan(ratio) else ratio


def bound_errors(off, left, most):
    """Return errors and what is left open, scaled down together where an error exceeds ``most``.

    Two rates differ by at most twice the largest. An infinite error leaves nothing open.
    """
    share = np.minimum(1, most / np.where(off > 0, off, most))
    infinite = np.isinf(off)
    bounded = np.where(infinite, most, np.minimum(off * share, most))
    return bounded, np.where(infinite, 0, np.minimum(left * share, most))


class TruncationLaw:
    """The law that rates follow from poses and equations of motion [Truncation].

    No ratio of errors to what the steps leave open is above 1.
    """

    def __init__(self, problem, states, reaction, speed, length):
        self.p, self.states = problem, states
        self.reaction = reaction  # lambda (n, rows of joints), or None
        self.speed, self.length = speed, length  # scales [m/s], [m]
        self.slow = speed / np.ptp(states[:, TIME])  # [m/s^2]: gains the speed in the run
        b, h = unpack(states), np.diff(states[:, TIME])
        self.size = np.abs(b.r).max() + problem.gyration.max()
        # [m]: loads (nb, 6) over it are forces, moments over the longest arm of the body's joints
        self.lever = np.repeat(np.stack([np.ones(problem.nb), problem.arm], 1), 3, 1)
        # up to 100 inner steps, evenly chosen where no body turns by 0.5 rad in a step; fewer for
        # large systems: 2e8 numbers of A^T A take some seconds
        turning = norm(b.Omega).max(1)
        fastest = np.max([turning[:-2], turning[1:-1], turning[2:]], 0)  # [rad/s]
        k = 1 + np.flatnonzero(fastest * np.maximum(h[:-1], h[1:]) < 0.5)
        self.inner, self.most = k, min(max(int(2e8 / problem.find_size()), 4), 100)
        self.steps = choose_evenly(k, self.most)

    def find_ratios(self):
        """Return the largest ratio of errors to bounds, and of acceleration to speed [1/s].

        Ratios above 1 are found again, with wider bounds, and divided by those of the exact motion.
        """
        self.doubts, self.jumps = [], 0.0  # in words; the ratio of reactions without ``own``
        if len(self.steps) < 3:
            self.doubts.append("under three steps turn by less than 0.5")
            return 0.0, 0.0
        a, load = self.find_answers(self.states, self.steps)
        velocities = self.judge_velocities(self.states, self.steps)
        accelerations, largest = self.judge_accelerations(self.states, self.steps, a)
        reactions = self.judge_reactions(load)
        self.jumps = self.judge_reactions(load, own=0)
        fastest = largest[np.isfinite(largest)].max(initial=0) / self.speed
        if max(accelerations, reactions) > 1 or not np.isfinite(largest).all():
            accelerations, reactions = self.judge_with_wider_bounds(a, load, largest)
        if max(velocities, accelerations) > 1:
            excuses = [max(1, 2 * ratio) for ratio in self.judge_exact_motion()]
            velocities, accelerations = velocities / excuses[0], accelerations / excuses[1]
        if min(velocities, accelerations, reactions) < 0:
            self.doubts.append("too few steps are known well enough")
        return max(velocities, accelerations, reactions), fastest

    def find_answers(self, states, k):
        """Return accelerations and loads at k-1, k, k+1, where poses are projected."""
        places = (k - 1, k, k + 1)
        return zip(*(self.p.accelerate(self.p.project(states[at])) for at in places), strict=True)

    def find_difference(self, one, other):
        """Return how far two fields differ: (k, nb), as motion distances do."""
        return self.p.find_distance(one[0] - other[0], one[1] - other[1])

    def judge_velocities(self, states, k):
        """Return the ratio of velocities: quotients of poses less (v; Omega) [m/s].

        Open: the difference of both quotients, 1 % of the speed scale, and rounding.
        """
        of_poses, _, turns, rounding = find_quotients(states, k)
        off = self.p.find_speed(of_poses[2] - unpack(states).rates[k])
        before, after = (find_field(of_poses[side], ZERO, turns[side] / 2) for side in (0, 1))
        left = self.find_difference(before, after) + 0.01 * self.speed + self.size * rounding
        return find_ratio(off, left)

    def judge_accelerations(self, states, k, a, wider=0, counted=True):
        """Return the ratio of accelerations: quotients of (v; Omega) less a of [Equations].

        Open: how much a changes to both neighbours, or both quotients differ, 1 % of the largest,
        rounding, and ``wider``. Also the largest acceleration of each step (k, 1) [m/s^2].
        """
        of_poses, of_rates, turns, rounding = find_quotients(states, k)
        b = unpack(states)
        here = find_field(a[1], b.Omega[k])
        before = find_field(a[0], b.Omega[k - 1], turns[0])
        after = find_field(a[2], b.Omega[k + 1], turns[1])
        largest = self.p.find_distance(*here).max(1, keepdims=True)
        largest = np.maximum(largest, self.slow)
        left = self.find_difference(before, here) + self.find_difference(after, here)
        before, after = (
            find_field(of_rates[side], of_poses[side][..., 3:], turns[side] / 2) for side in (0, 1)
        )
        left = np.maximum(left, self.find_difference(before, after))
        off, left = bound_errors(self.p.find_speed(of_rates[2] - a[1]), left, 2 * largest)
        fastest = self.p.find_speed(b.rates[k]).max()
        left = left + 0.01 * largest + fastest * rounding + wider
        return find_ratio(off, left, counted), largest

    def judge_reactions(self, load, wider=0, counted=True, own=1):
        """Return the ratio of reactions: A^T lambda less the loads of the equations of motion [N].

        Open: how much either changes to both neighbours, 1 % of the largest of each step, at least
        m speed / t_end, and ``wider``. With ``own`` 0 their own changes leave nothing open.
        """
        if self.reaction is None:
            return 0.0
        stated = []
        for k in (self.steps - 1, self.steps, self.steps + 1):
            A = self.p.differentiate(self.states[k])[:, self.p.row_is_joint]
            stated.append(np.einsum("tr,trbk->tbk", self.reaction[k], A) / self.lever)
        exact = [one / self.lever for one in load]
        changes = [norm(one[1] - one[0]) + norm(one[2] - one[1]) for one in (stated, exact)]
        largest = self.find_largest_load(load)
        off, left = bound_errors(
            norm(stated[1] - exact[1]), np.maximum(own * changes[0], changes[1]), 2 * largest
        )
        return find_ratio(off, left + 0.01 * largest + wider, counted)

    def find_largest_load(self, load):
        """Return the largest load on a body at each step, at least m speed / t_end (k, nb) [N]."""
        return np.maximum(norm(load[1] / self.lever).max(1)[:, None], self.p.mass * self.slow)

    def judge_with_wider_bounds(self, a, load, largest):
        """Return the ratios of accelerations and reactions, with wider bounds.

        They are wider by ten times the change where poses are moved at random by about their own
        error [m] and projected again. Steps count where it is at most a tenth of the largest value.
        """
        b, k = unpack(self.states), self.steps
        projected = self.p.project(self.states[k])
        near = unpack(projected)
        own = self.p.find_distance(b.r[k] - near.r, b.R[k] - near.R).max(1)
        own = np.fmin(np.fmax(own, 1e-9 * self.length), 1e-3 * self.length)  # of NaN the bound
        here, moved_a, moved_load = find_field(a[1], b.Omega[k]), 0, 0
        for seed in (0, 1):
            shift, turned = np.random.default_rng(seed).standard_normal((2, self.p.nb, 3))
            step = own[:, None, None] * np.append(shift, turned / self.p.arm.max(), 1)
            other_a, other = self.p.accelerate(self.p.project(self.p.move(projected, step)))
            change = self.find_difference(find_field(other_a, b.Omega[k]), here)
            moved_a = np.maximum(moved_a, change)
            moved_load = np.maximum(moved_load, norm((other - load[1]) / self.lever))
        counted = np.all(moved_a <= 0.1 * largest, 1)  # false where it is no number
        accelerations, _ = self.judge_accelerations(self.states, k, a, 10 * moved_a, counted)
        counted = counted & np.all(moved_load <= 0.1 * self.find_largest_load(load), 1)
        return accelerations, self.judge_reactions(load, 10 * moved_load, counted)

    def judge_exact_motion(self):
        """Return the ratios of velocities and accelerations of the exact motion at the same steps.

        Steps longer than half a period resolve not even that. 0 if under half have exact states, or
        if it contradicts the equations of motion.
        """
        t, exact_t, k = self.states[:, TIME], self.p.exact[:, TIME], self.steps
        k = k[np.isin([t[k - 1], t[k], t[k + 1]], exact_t).all(0)]
        if len(k) < max(3, 0.5 * len(self.steps)):
            return 0.0, 0.0
        exact = self.p.exact[np.isin(exact_t, t)]
        k = np.searchsorted(exact[:, TIME], t[k])  # the same steps
        a, _ = self.find_answers(exact, k)
        ratios = self.judge_velocities(exact, k), self.judge_accelerations(exact, k, a)[0]
        is_false = max(ratios) > 0.5 and self.contradicts_equations(exact, k)
        return (0.0, 0.0) if is_false else ratios

    def contradicts_equations(self, exact, k):
        """Return whether equations of motion lead from exact states k to others than the next.

        Where steps are too long to tell, this is noted.
        """
        k = choose_evenly(k, 12)
        is_clear, is_false = self.p.compare_with_equations(exact[k], exact[k + 1], 32)
        if not is_clear:
            self.doubts.append("the exact motion breaks it, too, at steps too long to tell")
        return is_false


def choose_evenly(k, most):
    """Return at most ``most`` evenly chosen entries of an array k."""
    return k[np.unique(np.linspace(0, len(k) - 1, min(most, len(k))).round().astype(int))]


# A motion -------------------------------------------------------------------------------------


class Run:
    """The states of one run, and the laws by which its record follows from them."""

    def __init__(self, report, problem, run, record, states, rows):
        self.report, self.compare, self.require = report, report.compare, report.require
        self.p, self.run, self.record, self.states, self.rows = problem, run, record, states, rows
        self.t, self.bodies = states[:, TIME], unpack(states)
        self.peaks = run["peaks_s"]  # times of maxima [s]
        self.first_breaks = {key: at for key, at in self.peaks.items() if ":first" in key}
        self.finite = np.isfinite(states[:, :-1]).all(1)  # (n)
        self.is_claimed = record["claimed"] == "success"
        self.is_success = record["status"] == "success"
        self.reasons = json.loads(record["wrong_because"])
        self.stated_reasons = sorted({reason["law"] for reason in self.reasons})
        self.has_exact_motion = len(problem.exact) > 0
        self.has_every_step = run["states"] == "every step"
        self.is_one_mechanism = len(problem.mechanisms) == 1
        self.horizon_reaches_end = problem.horizon >= problem.t_end
        self.is_whole = self.has_every_step or self.horizon_reaches_end  # its scales are complete
        self.exact_t = self.t[:0]  # times of states that have their exact state
        self.every_step_has_exact = False  # up to the horizon

    def check(self):
        """Compare the record with every law, in the order in which the laws build on each other."""
        self.check_steps()
        if self.is_claimed and not self.finite.all():
            found = self.record["status"], self.stated_reasons
            self.compare("status and reason", ("wrong", ["finite"]), recorded=found)
            return
        self.check_scales()
        self.check_limits()
        self.check_trend()
        series = self.list_series()
        self.check_maxima(series)
        self.check_errors_in_time()
        self.check_peaks()
        self.check_first_breaks()
        known = self.has_every_step and len(self.t) > 1
        defect = self.find_defect(self.states) if known else None
        self.compare("kinematic_defect", defect, 1e-9, why="not every step is kept")
        self.check_instants()
        self.check_reactions()
        self.check_invariants()
        self.check_rows(series)
        self.check_observables()
        self.check_status()

    def check_time(self, column, value, full):
        """Check a time [s] of a state: columns of ends are those at that very time, not near it."""
        if full:
            self.require(column, self.record[column] == value, self.record[column], value)
        else:
            self.compare(column, value, 0.0, full)

    def check_steps(self):
        """Check times, and steps less the last, which ends at t_end [Times and steps]."""
        record, every, t = self.record, self.has_every_step, self.t
        self.check_time("t_reached_s", float(t[-1]), every)
        starts = t[0] == 0 or "start" in self.stated_reasons or not (every and self.is_claimed)
        self.require("time of the first state", starts, t[0], 0.0)
        steps = np.diff(t)
        self.compare("steps", float(len(steps)), 0.0, every)
        self.require("states", every or len(steps) != record["steps"], "some steps", "every step")
        steps = steps[:-1] if len(steps) > 1 else steps
        known = every and len(steps) > 0
        least, median, most = np.quantile(steps, (0, 0.5, 1)) if known else 3 * [None]
        for name, value in {"min": least, "median": median, "max": most}.items():
            self.compare(f"step_{name}_s", value, ROUNDING * t[-1])
        self.compare("step_ratio", most / least if known else None)
        if known and record["control"] == "dt":
            asked, owed = record["dt_s"], self.is_success and record["suite"] != "refereed"
            fits = STEP_ASKED[0] * asked <= median <= STEP_ASKED[1] * asked
            self.require("dt_s", fits or not owed, asked, median)
            words = "without success whose steps are not the fixed step asked for"
            self.report.weaken(not fits and not owed, words)
            longer = self.is_success and most > STEP_ASKED[1] * asked
            self.report.weaken(longer, "with a step longer than the fixed step asked for")

    def check_scales(self):
        """Check length [m], speed [m/s], energy [J] and E(0): maxima of find_scales [Scales].

        Set the recorded scales, also by mechanism, and the sizes of terms whose sums are rounded.
        """
        p, record, full = self.p, self.record, self.is_whole
        about = self.states, min(self.first_breaks.values(), default=np.inf), full
        self.series, found = p.find_scales(*about, p.all_bodies)
        self.pose_size = np.abs(self.bodies.r[self.finite]).max(initial=0) + p.rim
        self.speed_size = np.nanmax(p.find_speed(self.bodies.rates)) + self.pose_size
        T, E, rests = self.series["T"], self.series["E"], found["is rest"]
        self.energy_size = np.nanmax(T + np.abs(E - T))
        self.compare("energy_start_J", found["energy start"], ROUNDING * found["energy terms"])
        self.compare("length_scale_m", found["length"], 0.0, full)
        self.compare("speed_scale_m_per_s", found["speed"], 0.0, full)
        # a difference of energies: 1e-9 where most of them is not exchanged
        self.compare("energy_scale_J", found["energy"], 1e-9 * found["energy terms"], full)

        # as NumPy's numbers: a quotient by 0 is infinite and raises nothing
        names = "length_scale_m", "speed_scale_m_per_s", "energy_scale_J"
        length, speed, energy = (np.float64(record[name]) for name in names)
        self.require("length above 0", length > 0 or not self.is_claimed, length)
        self.scales = found | {"length": length, "speed": speed, "energy": energy}
        if self.horizon_reaches_end or not self.has_exact_motion:
            self.scales |= {"gap": min(length, found["stretch"]), "reach": length}
        self.by_mechanism = [(self.series, self.scales)]
        if not self.is_one_mechanism:
            self.by_mechanism = [p.find_scales(*about, part) for part in p.mechanisms]

        if self.has_exact_motion:
            times = [at for key, at in self.peaks.items() if "scale " in key]
            kept = times or rests or not full
            kept = kept and np.isin(times, p.scale_states[:, TIME]).all()
            self.require("scales kept", kept, times, "even times of exact states")
        far = found["length"] > 10 * self.series["reach"].max()
        far = far or found["speed"] > 10 * self.series["speed"].max()
        far = far and self.has_exact_motion and self.is_success and full and not rests
        self.report.weaken(far, "whose exact motion goes ten times as far or as fast")
        words = "that stay at rest: within 1e-6 of their longest arm, which is their length"
        self.report.weaken(rests and self.is_claimed, words)

    def check_limits(self):
        """Check the limits of phi and phi_dot, where these are the gaps judged [Limits].

        Set the shares (n) of each limit, of the worst mechanism; the work on one of several is not
        stated, so its energy has none. error_factor (nb): whole length over a mechanism's own.
        """
        p, record, one = self.p, self.record, self.is_one_mechanism
        self.knows_shares = self.has_every_step
        if one:
            self.knows_shares = self.is_whole or not self.has_exact_motion
        self.knows_errors, self.knows_energy = self.knows_shares or one, one or not p.has_work
        self.error_factor = np.zeros(p.nb) if not one else np.ones(p.nb)
        self.shares = {law: np.zeros(len(self.t)) for law in p.laws}
        for part, (series, scales) in zip(p.mechanisms, self.by_mechanism, strict=True):
            if not one:
                self.error_factor += part * record["length_scale_m"] / scales["length"]
            for law, shares in self.shares.items():
                if law != "energy" or one or not p.does_work(part):
                    share = np.abs(series[law]) / (LIMITS[law] * scales[SCALES[law]])
                    self.shares[law] = np.maximum(shares, share)

        has_angles = (p.axes > 0).any() and p.row_is_joint.any()
        for column, law in (("phi_limit_m", "gap"), ("phi_dot_limit_m_per_s", "gap_rate")):
            if one and not p.literal and not has_angles:
                limit = LIMITS[law] * self.scales[SCALES[law]]
                self.compare(column, limit if self.knows_shares else None)
            else:
                self.require(column, np.isnan(record[column]), record[column], "nan")
        if p.normal is None:  # no plane to leave
            stated = record["out_of_plane_max_m"]
            self.require("out_of_plane_max_m", np.isnan(stated), stated, "nan")

    def check_trend(self):
        """Check the slope [W] and the means [J] of the energy error e [Energy trend].

        Slope = sum w (t - tm) e / sum w (t - tm) t, w the mean of both steps beside t, tm the mean
        of t with w. Means are trapezoidal over the first and the last quarter of the time.
        """
        t, e, span = self.t, self.series["energy"], np.ptp(self.t)
        known = self.has_every_step and len(t) > 2 and np.isfinite(e).all()
        slope, slack = None, ROUNDING * self.energy_size
        if known:
            w = np.convolve(np.diff(t), (0.5, 0.5))
            weighted = w * (t - w @ t / w.sum())
            slope = weighted @ e / (weighted @ t)
        self.compare("energy_trend_W", slope, slack / span)
        quarters = {"first": t <= t[0] + 0.25 * span, "last": t >= t[-1] - 0.25 * span}
        for name, inside in quarters.items():
            mean = None
            if known and inside.sum() > 1:
                mean = np.trapezoid(e[inside], t[inside]) / np.ptp(t[inside])
            self.compare(f"energy_mean_{name}_quarter_J", mean, slack)

    def list_series(self):
        """Return the series whose maxima are columns [Maxima]; of a plane |(r - r(0)).n| [Plane].

        Each is a row: stem, times, values (None if unknown), size of rounded terms, unit, which of
        the largest, the largest judged and the last must have a column, stored name.
        """
        m, shares, t, pose, p = self.series, self.shares, self.t, self.pose_size, self.p
        gap = shares.get("gap") if self.knows_shares else None
        gap_rate = shares.get("gap_rate") if self.knows_errors else None
        energy = shares["energy"] if self.knows_shares and self.knows_energy else None
        least = LIMITS["energy"] * min(scales["energy"] for _, scales in self.by_mechanism)
        eq81 = self.rows.get("eq81_norm", ())
        eq81 = eq81 if self.has_every_step and len(eq81) == len(t) else None
        series = [
            ("phi", t, m["phi"], pose, "", "max end", "phi_norm"),
            ("phi_dot", t, m["phi_dot"], self.speed_size, "", "max end", "phi_dot_norm"),
            ("energy_drift", t, m["energy"], self.energy_size, "_J", "max end", "energy_error"),
            ("orthogonality", t, m["orthogonality"], 1, "", "max", "orthogonality"),
            ("gap_share", t, gap, 1e3, "", "max", ""),  # shares of limits: 1e-9 of one is rounding
            ("gap_rate_share", t, gap_rate, 1e3, "", "max", ""),
            ("energy_share", t, energy, 1e3 + self.energy_size / least, "", "", ""),
            ("eq81", t, eq81, 0, "_sqrtJ", "", ""),
        ]
        if p.normal is not None:
            height = self.bodies.r @ p.normal  # (n, nb)
            known = self.has_every_step or t[0] == 0
            off = np.abs(height - height[0]).max(1) if known else None
            series.append(("out_of_plane", t, off, pose, "_m", "max", "out_of_plane"))
        return series + (self.list_errors() if self.has_exact_motion else [])

    def list_errors(self):
        """Return the series of errors at states with an exact state, of the worst body [Errors].

        Position, velocity, angular velocity: |a - a*|; orientation: 2 asin(|R - R*| / sqrt 8);
        motion [m] and rate [m/s]: motion distances, of mechanisms by their own length.
        """
        p, pose = self.p, self.pose_size
        t, own, exact = np.intersect1d(self.t, p.exact[:, TIME], return_indices=True)
        self.exact_t, self.exact_rows, self.stated_error = t, own, p.exact[exact, STATED]
        covered = (self.t <= p.covered_to).sum()
        self.every_step_has_exact = self.has_every_step and len(own) == covered
        ours, exactly = unpack(self.states[own]), unpack(p.exact[exact])
        dr, dR, rates = ours.r - exactly.r, ours.R - exactly.R, ours.rates - exactly.rates
        self.motion_error = (p.find_distance(dr, dR) * self.error_factor).max(1)
        self.rate_error = (p.find_speed(rates) * self.error_factor).max(1)
        angle = 2 * np.arcsin((np.linalg.matrix_norm(dR).max(1) / np.sqrt(8)).clip(0, 1))
        position, v, Omega = (norm(a).max(1) for a in (dr, rates[..., :3], rates[..., 3:]))
        spin = 1 + np.abs(self.bodies.Omega[self.finite]).max(initial=0)
        motion, rate = (self.motion_error, self.rate_error) if self.knows_errors else (None, None)
        every, speed, stated = "max judged end", self.speed_size, "reference_own_error"
        return [
            ("position_error", t, position, pose, "_m", every, "position_error"),
            # asin loses half the digits
            ("orientation_error", t, angle, 1e4, "_rad", every, "orientation_error"),
            ("velocity_error", t, v, speed, "_m_per_s", "max", ""),
            ("angular_velocity_error", t, Omega, spin, "_rad_per_s", "max", ""),
            ("motion_error", t, motion, pose, "_m", "max judged", ""),
            ("rate_error", t, rate, speed, "_m_per_s", "judged", ""),
            (stated, t, self.stated_error, 1e-3 * pose, "_m", "judged", stated),
        ]

    def check_maxima(self, series):
        """Check the largest, the largest judged and the last value of each series [Maxima].

        With every step, the largest is that at its stated time [Peaks].
        """
        record, peaks = self.record, self.peaks
        ends = {"max": np.inf, "judged": record["judged_to_s"], "end": record["t_reached_s"]}
        for stem, at, values, size, unit, columns, _ in series:
            has_all = self.every_step_has_exact if at is self.exact_t else self.has_every_step
            why = "Eq. (81) is not described" if stem == "eq81" else "its states are not kept"
            for which, last in ends.items():
                name, is_end = f"{stem}_{which}{unit}", which == "end"
                span = at == last if is_end else at <= last
                largest = None
                if values is not None and span.any():
                    largest = values[span].max() if is_end else np.abs(values[span]).max()
                if span.any() and (which in columns or name in record):
                    full = has_all or is_end or peaks.get(name) in at
                    self.compare(name, largest, ROUNDING * size, full, why=why)
                has_peak = name in peaks or not np.isnan(float(record.get(name, np.nan)))
                has_peak = has_peak and not is_end and stem != "reference_own_error" and len(at) > 0
                if has_peak and has_all and values is not None:
                    there = at == peaks.get(name)
                    value = float(np.abs(values[there]).max()) if there.any() else -1.0
                    largest = 0.0 if largest is None else largest
                    largest = np.inf if np.isnan(largest) else largest
                    self.compare(f"at its time: {name}", value, ROUNDING * size, recorded=largest)

    def check_errors_in_time(self):
        """Check how long a run is compared, judged, and tracks the exact motion [s] [In time].

        It is judged while the stated error is below 1e-9 length, or below 1e-3 length and 100 times
        its value at a tenth of the time; accurate while the motion error is below a share of the
        length + stated error.
        """
        record, at, every = self.record, self.exact_t, self.has_every_step
        full = self.every_step_has_exact
        if not len(at):
            names = "compared_to_s", "judged_to_s", "motion_error_max_m", "reference_horizon_s"
            for column in names if every else ():
                self.require(column, np.isnan(record[column]), record[column], "nan")
            return
        covered = self.t[self.t <= self.p.covered_to]
        self.check_time("compared_to_s", float(covered[-1]), every)
        has_all = full or not (self.report.lossless and every)
        self.require("exact states", has_all, len(at), len(covered))
        stated, length = self.stated_error, record["length_scale_m"]
        self.compare("reference_own_error_m", stated.max(), 1e-15 * self.pose_size, full)

        # of each step the last one up to a tenth of its time, but not the first of several
        tenth = np.searchsorted(at, at / 10, "right") - 1
        tenth = np.maximum(tenth, full and len(at) > 1)
        limit = np.where(stated <= 100 * stated[tenth], 1e-3, 1e-9) * length
        self.judged_count = max(np.logical_and.accumulate(stated < limit).sum(), 1)
        self.check_time("judged_to_s", float(at[self.judged_count - 1]), full)
        known = full and (self.knows_shares or self.is_one_mechanism)
        for column, level in ACCURATE.items():
            off = ~(self.motion_error <= level * length + stated)
            until = at[np.argmax(off)] if off.any() else at[-1]
            self.compare(column, float(until) if known else None)

    def check_peaks(self):
        """Check the times of errors in time and of instants, if every step is kept [Peaks]."""
        record, peaks = self.record, self.peaks
        if self.every_step_has_exact and len(self.exact_t):
            names = ["judged_to_s", "compared_to_s", *(ACCURATE if self.knows_errors else ())]
            for name in names:
                # accurate to the end: there is no time at which it was not
                is_end = name in ACCURATE and name not in peaks and record[name] == self.exact_t[-1]
                same = is_end or peaks.get(name) == record[name]
                self.require(f"time {name}", same, peaks.get(name), record[name])
            words = "compared with an exact motion at fewer than three steps"
            self.report.weaken(self.is_claimed and self.judged_count < 3, words)
        short = self.has_exact_motion and not record["judged_to_s"] >= 0.5 * self.p.t_end
        words = "compared with an exact motion for under half of their time"
        self.report.weaken(self.is_claimed and short, words)
        for name in INSTANTS if self.has_every_step else ():
            self.require(f"time {name}", name in peaks or not np.isfinite(record[name]), "no time")

    def check_first_breaks(self):
        """Check when each law was first broken: its share above 1, or no number [First breaks].

        A claimed success that breaks a law is wrong, whichever steps are kept.
        """
        known = {f"{SHARE_COLUMNS[law]}:first" for law in self.p.laws}
        self.require(":first", set(self.first_breaks) <= known, sorted(self.first_breaks), known)
        is_right = self.first_breaks and self.is_claimed and self.record["status"] != "wrong"
        self.require("status: a law is broken", not is_right, self.record["status"], "wrong")
        for law, shares in self.shares.items():
            name = f"{SHARE_COLUMNS[law]}:first"
            stated, broken = self.peaks.get(name), ~(shares <= 1)  # of NaN, too
            first = self.t[np.argmax(broken)] if broken.any() else None
            if law == "energy" and not self.knows_energy:
                first = stated if stated in self.t else None  # some step
            if self.has_every_step and self.knows_shares:
                self.require(name, stated == first, stated, first)

    def find_defect(self, states):
        """Return by what fraction of the path poses and velocities disagree [Kinematic defect].

        Sum of distances of (r + h v, R exp(h Omega)), means of both ends, from the next pose, over
        0.01 length + the larger of the sums of distances of poses and of h speed; worst body.
        """
        b, h = unpack(states), np.diff(states[:, TIME])[:, None, None]
        distance = self.p.find_distance
        moved = h * (b.rates[1:] + b.rates[:-1]) / 2
        shift, turned = moved[..., :3], moved[..., 3:]
        off = distance(b.r[:-1] + shift - b.r[1:], b.R[:-1] @ exp(turned) - b.R[1:]).sum(0)
        of_poses = distance(b.r[1:] - b.r[:-1], b.R[1:] - b.R[:-1]).sum(0)
        path = np.maximum(of_poses, self.p.find_speed(moved).sum(0))
        return (off / (path + 0.01 * self.record["length_scale_m"])).max()

    def find_exact_defect(self):
        """Return the defect of the exact motion at the same steps, if that of the run exceeds 0.5.

        The steps may then be too long. It is 0 if fewer than half of them are before the horizon;
        if not every step is kept, the value agrees with the stated reasons.
        """
        if not self.record["kinematic_defect"] > 0.5:
            return 0.0
        covered = self.t[self.t <= self.p.covered_to]
        exact = np.isin(self.p.exact[:, TIME], covered)
        if self.has_every_step and exact.sum() == len(covered):
            enough = len(covered) >= max(2, 0.5 * len(self.t))
            return self.find_defect(self.p.exact[exact]) if enough else 0.0
        self.report.undecided.append(("not every step is kept", "law kinematic"))
        return 0.0 if "kinematic" in self.stated_reasons else self.record["kinematic_defect"]

    def check_instants(self):
        """Check the error between steps, errors of reactions and their sizes [Instants]."""
        for column in (name for name in INSTANTS if name in self.peaks):
            at = self.peaks[column]
            exact = self.p.exact[self.p.exact[:, TIME] == at]
            own, value = self.states[self.t == at], None
            between = column == "motion_between_max_m"
            here = (len(exact) and (between or len(own))) or not self.every_step_has_exact
            self.require(f"states of {column}", here, at, "a time whose states are kept")
            if not between:
                self.check_load(column, exact, own)
                continue
            if len(exact) and (self.has_every_step or self.run["between"]):
                (r, R), exactly = interpolate_pose(self.states, at), unpack(exact)
                value = self.p.find_distance(r - exactly.r, R - exactly.R).max()
            self.compare(column, value, ROUNDING * self.pose_size)
        no_reactions = np.isnan(self.record["reaction_error_max_N"]) and self.p.row_is_joint.any()
        words = "without reactions, whose errors cannot be judged"
        self.report.weaken(self.is_claimed and no_reactions, words)
        nothing = np.isnan(self.record["motion_between_max_m"]) and self.has_exact_motion
        words = "without a comparison of the motion between steps"
        self.report.weaken(self.is_claimed and nothing, words)

    def check_load(self, column, exact, own):
        """Check the largest force [N] or moment [N m] about C on a body, by joints [Instants].

        Sizes: of the exact loads A^T lambda, moments at least force times arm. Errors: of the exact
        loads less A^T lambda of the run's reactions and pose.
        """
        p, is_error = self.p, column in REACTIONS
        if not len(exact) or p.has_user_forces or (is_error and not len(own)):
            self.compare(column, None)
            return
        load, reaction = p.accelerate(p.project(exact))[1], self.run["reactions"].get(column)
        if is_error:
            self.require("reactions", reaction is not None, "none", f"those of {column}")
            if reaction is None:
                return
            A = p.differentiate(own)[0][p.row_is_joint]  # (rows, nb, 6)
            load = load - np.tensordot(reaction, A, 1)
        force, moment = norm(load[..., :3]), norm(load[..., 3:])
        if column == "moment_size_Nm":
            moment = np.maximum(moment, p.arm * force)
        value = moment if column.startswith("moment") else force
        size = self.record[REACTIONS.get(column, column)]
        self.compare(column, float(value.max()), 1e-6 * size)

    def check_reactions(self):
        """Check that reactions are those of the series, and none if cut short [Instants]."""
        record, of_series = self.record, self.rows.get("state_reaction")
        if of_series is None:
            lacks = self.report.lossless and np.isfinite(record["reaction_error_max_N"])
            self.require("reactions", not lacks, "an error", "none: no reactions")
            return
        self.require("reactions", record["claimed"], "reactions", "none: cut short")
        words = "with reactions that are no numbers at some steps"
        self.report.weaken(record["claimed"] and not np.isfinite(of_series).all(), words)
        for column, reaction in self.run["reactions"].items() if self.has_every_step else ():
            here = self.t == self.peaks.get(column)
            same = here.any() and np.array_equal(of_series[here][0], reaction, equal_nan=True)
            self.require("reactions", same, "another", "that of the series")

    def measure_quantity(self, about):
        """Return the values (n) of an invariant: a quantity along a direction [Invariants].

        momentum: sum m v; angular momentum: sum r x m v + R J Omega; of one body spin: R J Omega,
        rate: Omega in its frame.
        """
        p, b, quantity = self.p, self.bodies, about["quantity"]
        momenta = b.v * p.mass[:, None]
        spins = np.einsum("tbij,bjk,tbk->tbi", b.R, p.inertia, b.Omega)
        if quantity == "momentum":
            return momenta.sum(1) @ about["along"]
        if quantity == "angular momentum":
            return (np.cross(b.r, momenta) + spins).sum(1) @ about["along"]
        values = spins if quantity == "spin" else b.Omega
        return values[:, about.get("body", 0)] @ about["along"]

    def check_invariants(self):
        """Check that invariants are those of the problem, and drift as the states do [Invariants].

        The stored series tells those that the problem does not describe. Limit: 0.1 of the larger
        of the scale of the unit and the start.
        """
        described, drifts = self.p.invariants, json.loads(self.record["invariant_drifts"])
        self.drifts, self.breaks_invariant = drifts, False
        same = not described or set(drifts) == set(described)
        self.require("names of invariants", same, sorted(drifts), sorted(described))
        self.report.weaken(not drifts, "without invariants")
        unknown = not all("quantity" in described.get(name, {}) for name in drifts)
        self.report.weaken(unknown, "with invariants that their problem does not describe")
        scales = self.scales
        turning, spin = scales["momentum"] * scales["reach"], scales["speed"] / scales["reach"]
        units = {"J": scales["energy"], "m": scales["length"], "m/s": scales["speed"]}
        units |= {"rad/s": spin, "kg m/s": scales["momentum"], "kg m2/s": turning, "N m s": turning}
        for name, drift in drifts.items():
            about = {"quantity": "", "along": ZERO, "unit": drift["unit"]} | described.get(name, {})
            unit = about["unit"]
            self.require(f"invariant {name}: unit", drift["unit"] == unit, drift["unit"], unit)
            values = self.measure_quantity(about)
            known = bool(about["quantity"]) and self.t[0] == 0
            row, start = self.rows.get(f"inv_{name}", ()), float(drift["start"])
            if not known and self.has_every_step and len(row) == len(self.t):
                values, known = row + start, True
            scale = units.get(unit, 0.0)
            slack = ROUNDING * max(np.nanmax(np.abs(values)), scale)
            off = values - values[0]
            found = {"start": values[0], "end": off[-1], "max": np.abs(off).max()}
            for key, value in found.items():
                is_known = known and (key != "end" or self.t[-1] == self.record["t_reached_s"])
                what, full = f"invariant {name}: {key}", key != "max" or self.has_every_step
                self.compare(what, value if is_known else None, slack, full, float(drift[key]))
            limit = 0.1 * max(scale, abs(start))
            if limit != 0:
                self.breaks_invariant |= not float(drift["max"]) <= limit
            elif float(drift["max"]) != 0:
                self.report.undecided.append(("its unit has no scale", f"invariant {name}"))

    def check_rows(self, series):
        """Check that the series of a lossless bundle are those of its states [Series]."""
        owed = self.has_every_step and self.report.lossless
        self.rows = rows = self.rows if owed else {}
        known = {name: (values, size) for _, _, values, size, _, _, name in series if name}
        known["t"] = self.t, 0.0
        known["dt"] = np.insert(np.diff(self.t), 0, np.nan), 0.0
        known["energy"] = self.series["E"], self.energy_size
        lacking = {*known, "eq81_norm", *(f"inv_{name}" for name in self.drifts)} - set(rows)
        self.require("series listed", not (owed and lacking), "none", sorted(lacking))
        other = {name for name, row in rows.items() if len(row) != len(self.t)}
        self.require("series lengths", not other, sorted(other), f"{len(self.t)} numbers")
        for name in sorted(set(known) & set(rows) - other):
            values, size = known[name]  # steps with an exact state come first
            finite = np.isfinite(values)
            if finite.any():
                off = np.abs(rows[name][: len(values)] - values)[finite].max()
                allowed = ROUNDING * size + RELATIVE * np.abs(values[finite]).max()
                self.require(f"series {name}", off <= allowed, "other values", f"off by {off:.3g}")

    def check_observables(self):
        """Check errors of observables, which are code, against their series alone [Series]."""
        for name, error in json.loads(self.record["observable_errors"]).items():
            own, exact = self.rows.get(f"obs_{name}"), self.rows.get(f"ref_{name}")
            found, slack = {"max": None, "end": None}, 0.0
            off = () if own is None or exact is None else np.abs(own - exact)[: len(self.exact_t)]
            if len(off):
                found = {"max": float(off.max()), "end": float(off[-1])}
                slack = ROUNDING * np.abs(exact[np.isfinite(exact)]).max(initial=0)
            for key, value in found.items():
                what, recorded = f"observable {name}: {key}", float(error[key])
                self.compare(what, value, slack, recorded=recorded, why="observables are code")

    def list_limits(self):
        """Return value and limit of each law that a claimed success must keep [Status]."""
        record, scales = self.record, self.scales
        length, speed, energy = scales["length"], scales["speed"], scales["energy"]
        stated_error = record["reference_own_error_judged_m"]
        start = np.inf if self.has_every_step else np.nan
        if self.t[0] == 0:
            start = np.abs(self.states - self.p.start)[0, 1:-1].max()
        drift = record["energy_drift_max_J"], LIMITS["energy"] * energy
        if not self.is_one_mechanism:
            drift = self.shares["energy"].max() if self.knows_shares else 0.0, 1.0
            if not (self.knows_shares and self.knows_energy):
                why = "the work of each mechanism is not stated"
                why = why if self.knows_shares else "not every step is kept"
                self.report.undecided.append((why, "law energy"))
                drift = (np.inf, 1.0) if "energy" in self.stated_reasons else drift
        force, moment = record["reaction_size_N"], record["moment_size_Nm"]
        return {
            "end": (abs(record["t_reached_s"] - self.p.t_end), 1e-9 * max(self.p.t_end, 1)),
            "start": (start, 1e-9 * (1 + length + speed)),
            "energy": drift,
            "constraint": (record["gap_share_max"], 1.0),
            "constraint_rate": (record["gap_rate_share_max"], 1.0),
            "orthogonality": (record["orthogonality_max"], LIMITS["orthogonality"]),
            "reaction": (record["reaction_error_max_N"], 10 * (force + energy / length)),
            "moment": (record["moment_error_max_Nm"], 10 * (moment + energy)),
            "kinematic": (record["kinematic_defect"] - self.find_exact_defect(), 0.5),
            "velocity": (record["rate_error_judged_m_per_s"], speed),
            "motion": (record["motion_error_judged_m"], 0.1 * length + stated_error),
            "rows": (record["motion_between_max_m"], 0.5 * length + stated_error),
        }

    def find_broken(self, excesses):
        """Return the names of the broken laws, also by a limit or needed value of NaN [Status]."""
        has_gap = "gap" in self.p.laws and self.p.row_is_joint.any()
        needed = {"end", "energy", "orthogonality"} | ({"constraint"} if has_gap else set())
        needed |= {"motion", "velocity"} if len(self.exact_t) else set()
        broken = {"invariant"} if self.breaks_invariant else set()
        for law, (value, limit) in excesses.items():
            if not value <= limit and (law in needed or not np.isnan(value)):
                broken.add(law)
        if self.has_exact_motion and not broken & INACCURATE_LAWS and self.breaks_truncation():
            broken.add("truncation")
        return broken - {"rows"} if broken & {"motion", "velocity"} else broken

    def breaks_truncation(self):
        """Return whether rates disagree with poses or the equations of motion [Truncation].

        Where the bundle cannot decide it, this is noted and the record's own reasons are returned.
        """
        if self.p.has_user_forces or not self.has_every_step:
            why = "user forces are code" if self.p.has_user_forces else "not every step is kept"
            self.report.undecided.append((why, "law truncation"))
            return "truncation" in self.stated_reasons
        reaction = self.rows.get("state_reaction")
        speed, length = self.scales["speed"], self.scales["length"]
        truncation = TruncationLaw(self.p, self.states, reaction, speed, length)
        ratio, fastest = truncation.find_ratios()
        self.report.undecided += [(why, "law truncation") for why in truncation.doubts]
        broken = not np.max([ratio, self.find_rate_ratio(fastest)]) <= 1  # of NaN, too
        if self.is_success and not broken:
            self.check_drawn_steps(truncation)
        return broken

    def check_drawn_steps(self, truncation):
        """Check the ratios at other steps, drawn by a digest of the states [Truncation].

        Who forges knows the steps of the page, and could be honest at these alone.
        """
        inner, count = truncation.inner, len(truncation.steps) // 2
        if count > 2 and len(inner) > len(truncation.steps):
            reaction = self.rows.get("state_reaction", ZERO)
            digest = hashlib.sha256(self.states.tobytes() + reaction.tobytes()).digest()
            random = np.random.default_rng(int.from_bytes(digest))
            truncation.steps = np.sort(random.choice(inner, count, replace=False))
            ratio, _ = truncation.find_ratios()
            self.require("truncation at drawn steps", ratio <= DRAWN, ratio, f"at most {DRAWN}")
            doubts = [(why, "truncation at drawn steps") for why in truncation.doubts]
            self.report.undecided += doubts
        jumps = truncation.jumps > DRAWN
        self.report.weaken(jumps, "whose reactions jump from step to step, which hides false ones")

    def find_rate_ratio(self, fastest):
        """Return the largest judged rate error over what errors of poses allow [Truncation].

        Allowed: 2 (motion error + stated error)(1/median step + the larger of the fastest turn and
        ``fastest`` [1/s]). A rate error up to 0.01 speed gives 0.
        """
        judged = slice(self.judged_count if len(self.exact_t) else 0)
        t, rate = self.exact_t[judged], self.rate_error[judged].max(initial=0)
        if len(t) < 2 or rate <= 0.01 * self.record["speed_scale_m_per_s"]:
            return 0.0
        error = 2 * (self.motion_error + self.stated_error)[judged].max()
        fastest_turn = norm(self.bodies.Omega[self.exact_rows[judged]]).max()
        return rate / error / (1 / np.median(np.diff(t)) + max(fastest_turn, fastest))

    def check_status(self):
        """Check status and reasons against the laws, by columns checked above [Status]."""
        p, status = self.p, self.record["status"]
        if not self.is_claimed:
            ends = abs(self.t[-1] - p.t_end) <= 1e-9 * max(p.t_end, 1) and status not in JUDGED
            self.report.weaken(ends, "called failures though their motion reaches the end")
            return
        turned = self.is_success and p.find_reversed_joints(self.states).any()
        self.require("joints turned over", not turned)
        mirrored = self.is_success and (np.linalg.det(self.bodies.R) <= 0).any()
        self.require("mirrored bodies", not mirrored)
        excesses = self.list_limits()
        broken = self.find_broken(excesses)
        wrong = broken - INACCURATE_LAWS
        self.compare("status", "wrong" if wrong else "inaccurate" if broken else "success")
        self.compare("wrong_because", sorted(wrong or broken), recorded=self.stated_reasons)
        decided = {"kinematic", "motion", "velocity", "rows", "reaction", "moment", "orthogonality"}
        decided |= {"energy"} if self.is_one_mechanism else set()
        for reason in (reason for reason in self.reasons if reason["law"] in decided):
            for key, value in zip(("value", "limit"), excesses[reason["law"]], strict=True):
                what, recorded = f"reason {reason['law']}: {key}", float(reason[key])
                self.compare(what, float(value), recorded=recorded)


# The report -----------------------------------------------------------------------------------


class Report:
    """The comparisons in a bundle: findings (disagreements), undecided (why, what), weak, lacking.

    An exception means: no bundle. ``complete`` requires what a lossless one must have.
    """

    def __init__(self, path, complete=False):
        self.numbers, self.findings, self.undecided = 0, [], []
        self.weak = []  # words, one for each run with weaker evidence than others
        self.lacking = []  # words on runs of a suite that the bundle lacks
        self.label, self.record = "bundle", {}  # bundle, run or problem of the next comparisons
        files = read_files(path)
        head, records, runs = files["bundle.json"], files["records.json"], files["runs.json"]
        self.runs = len(runs)
        right = head["format"] == "mbsbench bundle" and head["version"] == VERSION
        refuse_unless(right, "not a bundle of version 5")
        by_id = {record["run_id"]: record for record in records}
        paired = len(runs) == len(by_id) == len(records)
        paired = paired and set(by_id) == {run["run_id"] for run in runs}
        refuse_unless(paired, "a run twice, or without a record")
        self.lossless = head["lossless"] is True
        self.complete = complete or self.lossless
        self.check_files(head, files, runs, records)
        self.check_suites(files, records)
        self.check_table(files["table.json"], records)
        problems = {}
        for key in sorted({str(run["problem"]) for run in runs if run["problem"]}):
            data, exact = files[f"problems/{key}.json"], files.get(f"references/{key}.npy")
            problems[key] = Problem(data, exact, key), data
        for key, (problem, data) in problems.items():
            self.label = key
            self.check_problem(problem, data)
            if len(problem.exact):
                own = [run for run in runs if str(run["problem"]) == key]
                self.check_exact_motion(problem, own, files)
        for run in runs:
            self.check_run(run, by_id[run["run_id"]], problems, files, head["codes"])

    def compare(
        self, column, value, slack=0.0, full=True, recorded=None, why="its states are not kept"
    ):
        """Compare a recorded value with the computed one, within 1e-6 of the recorded one + slack.

        ``None``, where nothing can be computed, is noted as undecided, with ``why``. Where ``full``
        is false, a computed value is a lower bound.
        """
        if recorded is None and column not in self.record:
            self.require(column, False, "no column", value)
            return
        recorded = self.record[column] if recorded is None else recorded
        same = value == recorded
        if isinstance(value, float):
            value = np.inf if np.isnan(value) else value
            recorded = float(recorded)
            allowed = RELATIVE * abs(recorded) + slack
            same = value == recorded or abs(value - recorded) <= allowed < np.inf
        if value is None:
            self.undecided.append((why, column))
        elif not same and not full and value <= recorded:
            self.undecided.append(("only a lower bound", column))
        else:
            self.require(column, same, recorded, value)

    def require(self, what, holds, stated="", found=""):
        """Count a comparison; note what is stated and what is found or expected unless it holds."""
        self.numbers += 1
        if not holds:
            line = f"{self.label:17} {what[:38]:38} {str(stated)[:48]:>24} {str(found)[:48]:>24}"
            self.findings.append(line)

    def require_equal(self, what, stated, found):
        """Count a comparison; note a disagreement unless ``stated`` equals ``found``."""
        self.require(what, stated == found, stated, found)

    def weaken(self, is_weak, words):
        """Note in words that a run has weaker evidence than others, if it has."""
        self.weak += [words] if is_weak else []

    def list_lines(self, path):
        """Return what to print: counts, disagreements, what is missing, weak or undecided."""
        counts = f"{self.runs} runs checked, {self.numbers} numbers compared"
        disagreements, undecided = len(self.findings), len(self.undecided)
        lines = [f"{path}: {counts}, {disagreements} disagreements, {undecided} undecided"]
        lines += self.findings + [f"  {words}" for words in self.lacking]
        for words in sorted(set(self.weak)):
            lines.append(f"  {self.weak.count(words)} of {self.runs} {words}")
        for why in sorted({why for why, _ in self.undecided}):
            names = [name for cause, name in self.undecided if cause == why]
            each = " ".join(f"{name} {names.count(name)}," for name in sorted(set(names)))
            lines.append(f"  {why}: {each}")
        return lines

    def check_run(self, run, record, problems, files, codes):
        """Check one record, and its motion if its states are kept."""
        self.label = record["run_id"]
        words = ("nan", "inf", "-inf")  # numbers that JSON does not have
        self.record = {name: float(x) if x in words else x for name, x in record.items()}
        problem, data = problems.get(run["problem"], (None, None))
        self.check_record(problem, data, codes)
        self.check_ending(run)
        self.check_costs()
        if self.check_evidence(run, problem):
            rows = self.read_rows(run, files)
            states = files[f"runs/{self.label}.npy"]
            sound = states.shape[1:] == problem.start.shape[1:] and len(states)
            refuse_unless(sound, f"runs/{self.label}.npy: no states of its problem")
            Run(self, problem, run, self.record, states, rows).check()

    def check_files(self, head, files, runs, records):
        """Check lossless, codes, and that the files are exactly those of the runs [Files]."""
        self.require("runs", self.runs > 0, "none", "at least one")
        stated = head["lossless"]
        owed = stated is True or (stated is False and not self.complete)
        self.require("lossless", owed, stated, "true, or false where not all is owed")
        codes = sorted({str(record["code"]) for record in records})
        self.require_equal("codes", head["codes"], codes)
        moving = {run["run_id"] for run in runs if run["states"] != "none"}
        claimed = {record["run_id"] for record in records if claims_success(record)}
        has_evidence = not claimed or claimed & moving
        self.require("evidence", has_evidence, "no state of any success", "states")

        described = [run for run in runs if run["problem"]]
        wanted = {f"runs/{run_id}.npy" for run_id in moving}
        wanted |= {f"problems/{run['problem']}.json" for run in described}
        if self.lossless:
            wanted |= {f"series/{run['run_id']}.npy" for run in described}
        have = {name for name in files if name.startswith(("runs/", "series/", "problems/"))}
        self.require("files", have == wanted, sorted(have - wanted)[:1], sorted(wanted - have)[:1])
        known = {f"references/{run['problem']}.npy" for run in described}
        lone = sorted({name for name in files if name.startswith("references/")} - known)
        self.require("references", not lone, lone[:1], "a problem")

    def check_suites(self, files, records):
        """Check that suites are TOML; count their runs that the bundle lacks [Files]."""
        environments = {}
        for name, content in files.items():
            if name.endswith(".toml"):
                try:
                    is_suite = isinstance(tomllib.loads(content.decode()).get("name", ""), str)
                except (ValueError, RecursionError):
                    is_suite = False
                self.require(name, is_suite, "no TOML, or its name is no text", "a suite")
            if match := re.fullmatch(r"environment\.(.*)\.json", name):
                environments[match[1]] = content
        for suite in sorted({str(record["suite"]) for record in records}):
            own = [record["environment"] for record in records if record["suite"] == suite]
            sizes = [environments.get(environment, {}).get("suite_runs") for environment in own]
            most = max((size for size in sizes if isinstance(size, int)), default=0)
            if most > len(own):
                missing = f"{most - len(own)} of {most} runs of the suite {suite!r} are not here"
                self.lacking.append(missing)
        for record in records:
            alone = record["environment"] not in environments
            self.weaken(alone, "without the packages and the machine of their run")

    def check_table(self, table, records):
        """Check every cell of the table [Table]."""
        keys = ("problem", "problem_parameters", "solver")
        groups = {}
        for record in records:
            groups.setdefault(tuple(record[key] for key in keys), []).append(record)
        stated = [tuple(row[key] for key in keys) for row in table]
        refuse_unless(stated == sorted(groups), "the table has other rows")
        for row, group in zip(table, stated, strict=True):
            self.record, self.label = row, f"table {row['solver']}"[:17]
            cells = self.count_cells(groups[group])
            for column, value in cells.items():
                self.compare(column, value)
            self.require("columns", set(row) == {*cells, *keys}, sorted(row), "those of the page")

    def count_cells(self, records):
        """Return the cells of a row: counts, least error [m], least CPU time [s] at 1e-3 length."""
        statuses = [record["status"] for record in records]
        errors, times = [np.inf], [np.inf]
        for record in records:
            error, time = float(record["motion_error_judged_m"]), float(record["cpu_median_s"])
            if record["status"] == "success" and error < np.inf:
                errors.append(error)
                is_near = error <= 1e-3 * float(record["length_scale_m"])
                times += [time] if is_near and not np.isnan(time) else []
        cells = {status: statuses.count(status) for status in JUDGED} | {"runs": len(records)}
        return cells | {"least_cpu_s": min(times), "least_motion_error_m": min(errors)}

    def check_problem(self, p, data):
        """Check that names, user forces, gyrations, frame and plane fit the numbers [Numbers]."""
        self.require_equal("body_names", len(data["body_names"]), p.nb)
        self.require_equal("joint_names", len(data["joint_names"]), int(p.is_joint.sum()))
        self.require_equal("joint_kinds", len(data["joint_kinds"]), len(p.i))
        forces = [f"user force {k}" for k in range(p.user_count)]
        self.require_equal("not_serialised", data["not_serialised"], forces)
        J = p.inertia
        J1, J2, J3 = np.linalg.eigvalsh(J).T
        least = np.sqrt(np.linalg.trace(J) / (2 * p.mass))
        # a point mass has a share of its arm; one that is too large would call any motion rest
        rod = p.length[np.isin(p.kinds, LONG)].max(initial=0)  # no other joint reads its length
        arm = max(p.joint_arm.max(), rod, least.max()) or 1
        most = np.where(J3 > 0, SLENDER * least, arm)
        near = (p.gyration >= least * (1 - RELATIVE)) & (p.gyration <= most * (1 + RELATIVE))
        self.require("gyration", near.all(), p.gyration, f"{least} or {most}")
        of_matter = (J1 >= -ROUNDING * J3).all() and (J3 <= (J1 + J2) * (1 + 1e-9)).all()
        of_matter = of_matter and np.abs(J - J.mT).max() <= ROUNDING * J3.max()
        self.require("inertia", of_matter, "no inertia", "that of some distribution of mass")
        for key in ("k", "c"):
            stray = vars(p)[key][~np.isin(p.kinds, ("spring", "torsion"))].any()
            self.require(f"joint_{key}", not stray, "of others", "of springs and torsions alone")
        has_rows = np.isin(np.arange(len(p.i)), p.row_joint).all()
        self.require("joint without rows", has_rows, "joins bodies", "at least one row")
        for key, off in p.find_direction_errors().items():
            self.require(key, off < 1e-9, off, "of length 1, at right angles")
        for key in ("frame", "start_R"):
            R = np.array(data["numbers"][key], float).reshape(-1, 3, 3)
            is_rotation = np.abs(R.mT @ R - IDENTITY).max() < 1e-9 and (np.linalg.det(R) > 0).all()
            self.require(key, is_rotation, "no rotation, or a mirror image", "a rotation")
        least = np.select([np.isin(p.kinds, LONG), p.kinds == "spring"], [STEP, 0], -np.inf)
        self.require("joint_length", (p.length >= least).all(), p.length.min(initial=0), "above 0")
        is_unit = p.normal is None or abs(norm(p.normal) - 1) < 1e-9
        self.require("planar_normal", is_unit, "its length", 1)
        kind = data["reference"]["kind"]
        known = kind in ("own", "certified", "computed") or (kind == "none" and not len(p.exact))
        self.require("reference: kind", known, kind, "a kind, none without exact states")
        names = [about["name"] for about in data["invariants"]]
        self.require("invariants", len(set(names)) == len(names), names, "each once")
        for about in data["invariants"]:
            if "quantity" in about:
                known = about["unit"] in UNITS.get(about["quantity"], ())
                known = known and abs(norm(about["along"]) - 1) < 1e-9
                body = about.get("body", 0)
                known = known and isinstance(body, int) and 0 <= body < p.nb
                self.require(f"invariant {about['name']}", known, about, "a quantity along a unit")

    def check_equations(self, p):
        """Check that the equations of motion lead from exact states to the next [Exact motion].

        From twelve of the half that the next ones are closest to, drawn by a digest of all; states
        within a millionth of the time of one another tell nothing.
        """
        h = np.diff(p.exact[:, TIME])
        apart = h > 1e-6 * p.t_end
        close = np.flatnonzero(apart & (h <= np.median(h[apart]))) if apart.any() else []
        seed = int.from_bytes(hashlib.sha256(p.exact.tobytes()).digest())
        k = np.sort(np.random.default_rng(seed).permutation(close)[:12]).astype(int)
        is_clear, is_false = False, False
        if len(k):
            is_clear, is_false = p.compare_with_equations(p.exact[k], p.exact[k + 1], 2)
        self.require("reference: equations", not is_false, "another motion", "that of its forces")
        if not is_clear:
            why = "its equations lead nowhere clearly: too large, or its states too far apart"
            why = "user forces are code" if p.has_user_forces else why
            self.undecided.append((why, "reference: equations"))

    def check_exact_motion(self, p, runs, files):
        """Check that the exact motion keeps the laws to its stated errors [Exact motion].

        Allowed: 1e-9 + 100 stated error / size of phi over size, phi_dot over the fastest rate,
        orthogonality, E - E(0) over the largest energy, if no work is done; and of a closed form.
        Its states are at steps, scales and instants of its runs alone, and no farther from one
        another than twice the fastest speed times the time between them.
        """
        t, stated = p.exact[:, TIME], p.exact[:, STATED]
        b, series = unpack(p.exact), p.measure_series(p.exact, p.all_bodies)
        size, speed = np.abs(b.r).max() + p.rim, p.find_speed(b.rates).max()
        sane = (stated >= 0).all() and (stated < 0.1 * size).all() and np.isfinite(p.exact).all()
        sane = sane and t[0] >= 0 and t[-1] <= p.covered_to and (np.linalg.det(b.R) > 0).all()
        self.require("reference: errors and horizon sane", sane)
        # a large error between small ones would set scales that nothing judges
        falls = np.maximum.accumulate(stated) > 100 * stated + 1e-9 * size
        self.require("reference: errors that fall", not falls.any(), stated.max(), "by under 100")

        # a state far off would set scales, too, though nothing gets there and back in the time
        far = p.find_distance(np.diff(b.r, axis=0), np.diff(b.R, axis=0)).max(1, initial=0)
        reached = PACE * speed * np.diff(t) + stated[:-1] + stated[1:] + 1e-9 * size
        self.require("reference: pace", (far <= reached).all(), "states far apart", "slower")

        allowed = 1e-9 + 100 * stated.clip(0) / size
        laws = {"phi": series["phi"] / size, "phi_dot": series["phi_dot"] / max(speed, 1e-9 * size)}
        laws |= {"orthogonality": series["orthogonality"], "energy": None, "start": None}
        if not p.has_work:
            energy, kinetic = series["E"], series["T"]
            largest = kinetic.max() + np.abs(energy - kinetic).max() + 1e-300  # not 0 of rest
            laws["energy"] = (energy - p.measure_series(p.start, p.all_bodies)["E"]) / largest
        if t[0] == 0:
            off = np.abs(p.exact - p.start)[0, 1:-1].max() / (1e-9 * (1 + size + speed))
            laws["start"] = allowed * off  # whatever the stated error is
        if sane:
            self.check_equations(p)
        if "Lagrange's top" in p.route:
            laws["closed form"] = allowed * p.find_top_error() / (RELATIVE + 2 * stated / size)
        elif "proved" in p.route:
            self.undecided.append(("no closed form here: others prove its motion", "reference"))
        for law, defect in laws.items():
            worst = None if defect is None else float(np.abs(defect / allowed).max())
            why = "work is done, or no exact start is kept"
            self.compare(f"reference: {law} / allowed", worst, 1, True, 0.0, why)

        # each mechanism has its own scales, of which only those of the whole are named
        times = [*p.scale_states[:, TIME]] if len(p.mechanisms) > 1 else []
        for run in runs:
            times += [*files.get(f"runs/{run['run_id']}.npy", p.start[:0])[:, TIME]]
            peaks = run["peaks_s"].items()
            times += [at for name, at in peaks if name in INSTANTS or "scale " in name]
        lone = t[~np.isin(t, times)]
        self.require("reference: times", not len(lone), lone[:1], "steps and peaks of its runs")

    def check_record(self, p, data, codes):
        """Check schema, code, that a step or a tolerance is asked for, and the problem [Record]."""
        record = self.record
        self.require_equal("schema", record["schema"], SCHEMA)
        self.require("code", record["code"] in codes, record["code"], codes)
        has_step, has_tolerance = record["dt_s"] > 0, record["rtol"] > 0
        asked = "dt" if has_step else "rtol"
        sound = has_step != has_tolerance and record["control"] == asked
        self.require("control", sound, record["control"], asked)
        if p is None:
            return
        parameters = json.loads(record["problem_parameters"])
        self.require_equal("problem", record["problem"], data["problem"])
        self.require_equal("problem_parameters", parameters, data["parameters"])
        self.require_equal("section", record["section"], data["section"])
        self.compare("t_end_s", p.t_end)
        literal = bool(parameters.get("literal_start"))
        self.require("literal_start", data["literal_start"] is literal, not literal, literal)
        self.require_equal("reference", record["reference"], p.route)
        horizon, stated = float(data["reference"]["horizon_s"]), record["reference_horizon_s"]
        same = horizon == stated or (np.isnan(horizon) and np.isnan(stated))
        self.require("reference_horizon_s", same, stated, horizon)
        claims = record["claimed"] == "success"
        self.weaken(claims and literal, "that start as printed, whose joints nobody judges")
        words = "with user forces, which are code: work, reactions and truncation are as stated"
        self.weaken(claims and p.has_user_forces, words)
        self.weaken(claims and not len(p.exact), "without an exact motion")

    def check_ending(self, run):
        """Check that status, claim of the solver and cause of the end are consistent [Ending]."""
        record, require = self.record, self.require
        status, claimed, ended_by = record["status"], record["claimed"], record["ended_by"]
        require("claimed", claimed in CLAIMS, claimed, "a status of solvers")
        if not claimed:
            require("ended_by", ended_by in ENDINGS, ended_by, "the end of who claims nothing")
            self.require_equal("status", status, ENDINGS.get(ended_by, "crashed"))
            self.require_equal("counters", record["counters"], "{}")
        else:
            statuses, enders = JUDGED if claimed == "success" else (claimed,), ("solver",)
            if claimed == "stalled":
                statuses = ("stalled", "unfinished")
                enders = ("cpu_limit" if status == "unfinished" else "solver", "suspended")
            require("status", status in statuses, status, statuses)
            require("ended_by", ended_by in enders, ended_by, enders)
            codes = record["signal"], record["exit_code"]
            require("signal and exit_code", codes == (0, 0), codes, 0)
        if status == "refused":
            nothing = record["steps"] == 0 and np.isnan(record["t_reached_s"])
            nothing = nothing and run["states"] == "none" and not record["series"]
            require("refused", nothing, "a motion", "none")
        package = record["missing_package"]
        require("missing_package", status == "refused" or not package, package, "none")
        owed = status in ("inaccurate", "wrong") and claimed == "success"
        reasons = record["wrong_because"]
        require("wrong_because", (reasons != "[]") == owed, reasons, "reasons" if owed else "none")

    def check_costs(self):
        """Check costs: none below 0, CPU times in order, none above that of the process [Costs].

        The CPU times of a submission are of repeated processes, of which only one is recorded.
        """
        record, require = self.record, self.require
        for column in COSTS:
            require(column, not record[column] < 0, record[column], "at least 0")
        ordered = [record[column] for column in CPU_TIMES]
        known = [time for time in ordered if not np.isnan(time)]
        require("order of CPU times", known == sorted(known), ordered, "min, q1, median, q3, max")
        require("number of CPU times", len(known) in (0, 3, 5), ordered, "all or none")
        process, code = record["cpu_process_s"], record["code_s"]
        if known and not np.isnan(process):
            elsewhere = record["suite"] == "ladder" or '"CPU times: ' in str(record["notes"])
            within = elsewhere or known[-1] <= process + CLOCK
            require("cpu_process_s", within, process, known[-1])
            require("code_s", not code > process + CLOCK, code, process)
        words = "whose CPU times no time of their process bounds"
        self.weaken(known and np.isnan(process), words)
        repeated = record["repeats"] > 0 or not known or not claims_success(record)
        require("repeats", repeated, record["repeats"], "at least 1")

    def check_evidence(self, run, problem):
        """Check that a success has states; return whether its motion can be checked [Evidence]."""
        states = run["states"]
        allowed = ("none", "some steps", "every step")
        self.require("states", states in allowed, states, "none, some or every")
        self.require("problem", bool(run["problem"]) or states == "none", "states", "of a problem")
        if claims_success(self.record) and self.complete:
            self.require_equal("evidence", states, "every step")
        elif claims_success(self.record):
            self.weaken(states == "none", "that claim success without a state")
            words = "that claim success with the states of some steps"
            self.weaken(states not in ("none", "every step"), words)
        if states == "none":
            self.undecided.append(("no motion, or too large a state", "run"))
        return states != "none" and problem is not None

    def read_rows(self, run, files):
        """Return the series of a run by name; refuse any that do not fill their file [Evidence]."""
        arrays = run["arrays"]
        if not self.lossless:
            self.require("arrays", arrays == {}, sorted(arrays), "none")
            return {}
        vector = files[f"series/{self.label}.npy"]
        rows, at = {}, 0
        for name, (offset, shape) in sorted(arrays.items(), key=lambda item: item[1][0]):
            end = at + int(np.prod(shape))
            in_place = offset == at and vector.ndim == 1 and at <= end <= len(vector)
            in_place = in_place and min(shape, default=0) >= 0
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
    warnings.simplefilter("ignore")  # of states that are no numbers, which a finding says
    try:
        report = Report(Path(path), complete)
    except Exception as error:  # whatever the file may cause
        lines, code = [f"{path}: unreadable: {type(error).__name__}: {error}"[:400]], 2
    else:
        lines, code = report.list_lines(path), 1 if report.findings else 0
    for line in lines:
        print(line.encode("unicode_escape").decode())  # a bundle cannot control the terminal
    return code


if __name__ == "__main__":
    if hasattr(signal, "SIGPIPE"):  # a reader that has seen enough ends it without a word
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    paths = [word for word in sys.argv[1:] if word != COMPLETE]
    sys.exit(max((main(path, COMPLETE in sys.argv) for path in paths), default=2))
