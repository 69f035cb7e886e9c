"""Findings on disk: cases that the command repeats (JSON), mechanisms for other codes (MJCF), and a page of all."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import fill

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from ...solvers.engines.export.tree import Kind as LimbKind
from ...solvers.engines.export.tree import spanning_tree
from ..files import read_text, write_text
from ..mechanics.system import GROUND
from ..types import Problem
from .mechanism import Mechanism
from .oracle import FLOOR, Kind, Oracle, Outcome
from .presenting import Form

WIDTH = 118
NONE = "No other route was asked, or none confirms it."


@dataclass(frozen=True)
class Case:
    """A mechanism, its form, what a code does with them, and the evidence of other routes (empty: none)."""

    outcome: Outcome
    mechanism: Mechanism
    form: Form
    evidence: str = ""
    options: dict[str, str] = field(default_factory=dict)
    floor: float = FLOOR

    @property
    def name(self) -> str:
        """That of its files."""
        return f"{self.outcome.solver}-{self.outcome.number}"

    @property
    def oracle(self) -> Oracle:
        """To examine it again."""
        return Oracle(self.mechanism, self.form, self.floor)


def write_cases(folder: Path, cases: Sequence[Case], counts: Mapping[str, Mapping[Kind, int]], command: str) -> None:
    """Write a case and a mechanism for each, and ``README.md`` about all."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f"# Findings of {command}", "", *_table(counts)]
    for case in cases:
        text = msgspec.json.format(msgspec.json.encode(case), indent=1).decode()
        write_text(folder / f"{case.name}.json", text + "\n")
        try:
            write_text(folder / f"{case.name}.xml", mjcf(case.oracle.problem))
            file = f"MJCF: `{case.name}.xml`, which starts at its keyframe `start`."
        except ValueError as error:
            file = f"No MJCF: {error}."
        again = f"Repeat: `mbsbench fuzz {case.outcome.solver} --repeat {case.name}.json`. {file}"
        lines += ["", f"## {case.name}: {case.outcome.kind}", "", _parts(case.mechanism), ""]
        for text in (_numbers(case), case.evidence or NONE, again):
            lines += [fill(text, WIDTH, break_long_words=False, break_on_hyphens=False), ""]
        lines.pop()
    write_text(folder / "README.md", "\n".join(lines) + "\n")


def _numbers(case: Case) -> str:
    o, m = case.outcome, case.mechanism
    where = f"Form: `{case.form}`, {m.steps} steps of {m.dt:g} s."
    if not o.limit:
        return f"{where} {o.words}"
    coarse, fine = o.deviation
    what = "The answers differ" if o.kind is Kind.PRESENTATION else f"The answer (`{o.form}`) is off the true motion"
    return (
        f"{where} {what} by {coarse:.3g} m, with half the step or the finer tolerance by {fine:.3g} m. The code's own "
        f"error, by that refinement, is {o.own:.2g} m."
    )


def read_case(path: Path) -> Case:
    """A case that was written, or ValueError."""
    try:
        return msgspec.json.decode(read_text(path, "case"), type=Case)
    except msgspec.MsgspecError as error:
        raise ValueError(f"{path} is no case of fuzz: {error}") from None


def mjcf(problem: Problem) -> str:
    """The problem as MuJoCo's tree with cut joints, all digits printed; the keyframe ``start`` has its velocities."""
    s, start = problem.system, problem.initial
    if not s.is_pinned:
        raise ValueError("not written as MJCF: it has joints other than hinges and balls")
    tree = spanning_tree(s, start)
    root = ET.Element("mujoco", model="fuzz")
    ET.SubElement(root, "compiler", angle="radian")
    option = ET.SubElement(root, "option", gravity=_text(s.gravity), timestep=repr(problem.dt), integrator="RK4")
    ET.SubElement(option, "flag", contact="disable")
    parts = {GROUND: ET.SubElement(root, "worldbody")}
    for limb in tree.limbs:
        b, free = limb.body, limb.kind is LimbKind.FREE
        place = start.r[b] if free else limb.s_parent - limb.R_0 @ limb.s_child
        quaternion = Rotation.from_matrix(limb.R_0).as_quat(scalar_first=True)
        part = ET.SubElement(parts[limb.parent], "body", name=_name(b), pos=_text(place), quat=_text(quaternion))
        J = s.regular_inertia[b]
        full = (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
        ET.SubElement(part, "inertial", pos="0 0 0", mass=repr(float(s.mass[b])), fullinertia=_text(full))
        if free:
            ET.SubElement(part, "freejoint")
        else:
            joint = ET.SubElement(part, "joint", type=limb.kind.name.lower(), pos=_text(limb.s_child))
            if limb.kind is LimbKind.HINGE:
                joint.set("axis", _text(limb.axis))
        parts[b] = part
    if tree.cuts:
        rows = ET.SubElement(root, "equality")
        for cut in tree.cuts:
            row = ET.SubElement(rows, "connect", body1=_name(cut.i), anchor=_text(cut.s_i))
            if cut.j != GROUND:
                row.set("body2", _name(cut.j))
    if len(s.spring_k):
        tendons = ET.SubElement(root, "tendon")
        for k, law in enumerate(zip(s.spring_k, s.spring_c, s.spring_d0, strict=True)):
            stiffness, damping, length = (repr(float(x)) for x in law)
            cord = ET.SubElement(tendons, "spatial", stiffness=stiffness, damping=damping, springlength=length)
            for end, body, p in (("i", s.spring_i[k], s.spring_p_i[k]), ("j", s.spring_j[k], s.spring_p_j[k])):
                ET.SubElement(parts[int(body)], "site", name=f"spring {k} {end}", pos=_text(p))
                ET.SubElement(cord, "site", site=f"spring {k} {end}")
    keys = ET.SubElement(root, "keyframe")
    ET.SubElement(keys, "key", name="start", qpos=_text(tree.start), qvel=_text(tree.start_velocity))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _table(counts: Mapping[str, Mapping[Kind, int]]) -> list[str]:
    kinds = [k for k in Kind if any(of.get(k) for of in counts.values())]
    rows = [f"| {name} | {' | '.join(str(of.get(k, 0)) for k in kinds)} |" for name, of in sorted(counts.items())]
    return [f"| | {' | '.join(kinds)} |", f"|---|{'---|' * len(kinds)}", *rows]


def _parts(m: Mechanism) -> str:
    joints = ", ".join(f"{c.kind} {_end(c.i)}-{_end(c.j)}" for c in m.connections) or "no joints"
    return f"{len(m.bodies)} bodies; {joints}; {len(m.springs)} springs."


def _end(body: int) -> str:
    return "ground" if body == GROUND else str(body + 1)


def _name(body: int) -> str:
    return f"body {body + 1}"


def _text(a: Sequence[float] | np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in a)
