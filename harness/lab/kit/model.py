"""Define the model that the kit gives to an engine: the problem as numbers, as MJCF or as URDF, and a step."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ....solvers.engines.export.plain import flatten_tree
from ....solvers.engines.export.tree import Kind, build_spanning_tree
from ...catalogue.description import describe_problem
from ...mechanics.motion import evaluate_load
from ...mechanics.state import States
from ...mechanics.system import GROUND
from ...mechanics.types import Problem

FREE = Kind.FREE.name


@dataclass(frozen=True)
class Model:
    """Describe a problem to an engine, with bodies called ``body0``, ``body1``, ... in the order of its numbers."""

    name: str
    problem: Problem
    dt: float  # [s] the step to take

    @property
    def bodies(self) -> int:
        """Number of bodies."""
        return self.problem.system.nb

    @cached_property
    def numbers(self) -> dict[str, Any]:
        """The numbers that ``mbsbench export`` writes: masses, inertias, joints, start (docs/your-own-solver.md)."""
        return describe_problem(self.problem)

    @cached_property
    def tree(self) -> dict[str, Any]:
        """Joint coordinates: ``limbs`` from the ground outwards, ``cuts`` that close loops, start and velocities."""
        system, start = self.problem.system, self.problem.initial
        return flatten_tree(build_spanning_tree(system, start), system, start)

    @cached_property
    def links(self) -> list[dict[str, Any]]:
        """Bodies from the ground outwards, each with a frame at its joint that is parallel to the body at the start.

        Each has ``body``, ``parent`` (-1: the ground), ``kind`` (HINGE, SLIDE, BALL, FREE and others) and ``axes``;
        ``at`` and ``R_0``, the frame relative to that of the parent; ``centre``, the centre of mass C in the frame;
        ``mass``, and ``inertia`` about C; ``speed`` of the joint or, for a free body, v and omega, in the frame. The
        frame of a free body is at C.
        """
        arms, out, u = {GROUND: np.zeros(3)}, [], self.tree["start_velocity"]
        for x in self.tree["limbs"]:
            free, own = x["kind"] == FREE, u[x["u_at"] : x["u_at"] + Kind[x["kind"]].nu]
            arms[x["body"]] = np.zeros(3) if free else np.array(x["s_child"])
            speed = np.concatenate((x["R"].T @ own[:3], own[3:])) if free else own.copy()
            at = np.array(x["r"]) if free else x["s_parent"] - arms[x["parent"]]
            kept = {k: x[k] for k in ("body", "parent", "kind", "mass")}
            out.append(
                {
                    **kept,
                    "axes": [np.array(axis) for _, axis in x["moves"]],
                    "at": at,
                    "R_0": np.array(x["R_0"]),
                    "centre": -arms[x["body"]],
                    "inertia": np.array(x["inertia"]),
                    "speed": speed,
                }
            )
        return out

    @cached_property
    def loops(self) -> list[tuple[int, np.ndarray, int, np.ndarray]]:
        """Coincident points that close loops: body, point in the frame of ``links``; body, point."""
        centre = {GROUND: np.zeros(3)} | {x["body"]: x["centre"] for x in self.links}
        return [(c["i"], c["s_i"] + centre[c["i"]], c["j"], c["s_j"] + centre[c["j"]]) for c in self.tree["cuts"]]

    def torques(self, t: float) -> Float[np.ndarray, "nb 3"]:
        """Return the applied torques [N m, space] at ``t`` [s]; no case has forces."""
        system, out = self.problem.system, np.zeros((self.problem.system.nb, 3))
        here = States.one(self.problem.initial).with_times(np.array([t]))
        for k, body in enumerate(system.load_i):
            out[body] += evaluate_load(system, here, k)[1][0]
        return out

    @cached_property
    def mjcf(self) -> str:
        """The problem in MuJoCo's format; cut joints are ``connect``, the key frame ``start`` has the velocities."""
        tree, system = self.tree, self.problem.system
        top = ET.Element("mujoco")
        ET.SubElement(top, "compiler", angle="radian")
        option = ET.SubElement(top, "option", timestep=_text([self.dt]), gravity=_text(tree["gravity"]))
        ET.SubElement(option, "flag", contact="disable")
        parts = {GROUND: ET.SubElement(top, "worldbody")}
        for limb in tree["limbs"]:
            b, R_0 = limb["body"], limb["R_0"]
            pos = limb["r"] if limb["kind"] == FREE else limb["s_parent"] - R_0 @ limb["s_child"]
            part = ET.SubElement(parts[limb["parent"]], "body", name=f"body{b}", pos=_text(pos), quat=_quaternion(R_0))
            parts[b] = part
            moments = _text(limb["inertia"][[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
            ET.SubElement(part, "inertial", pos="0 0 0", mass=_text([limb["mass"]]), fullinertia=moments)
            if limb["kind"] == FREE:
                ET.SubElement(part, "freejoint")
            elif limb["kind"] == Kind.BALL.name:
                ET.SubElement(part, "joint", type="ball", pos=_text(limb["s_child"]))
            for slides, axis in limb["moves"]:
                spring = limb["torsion"] or {"stiffness": 0.0, "damping": 0.0, "rest_angle": 0.0}
                ET.SubElement(
                    part,
                    "joint",
                    type="slide" if slides else "hinge",
                    pos=_text(limb["s_child"]),
                    axis=_text(axis),
                    stiffness=_text([spring["stiffness"]]),
                    damping=_text([spring["damping"]]),
                    springref=_text([spring["rest_angle"]]),
                )
        tendons = ET.SubElement(top, "tendon") if tree["springs"] else top
        for k, s in enumerate(tree["springs"]):
            cord = ET.SubElement(
                tendons,
                "spatial",
                stiffness=_text([s["stiffness"]]),
                damping=_text([s["damping"]]),
                springlength=_text([s["rest_length"]]),
            )
            for end in "ij":
                ET.SubElement(parts[int(s[end])], "site", name=f"spring{k}{end}", pos=_text(s[f"p_{end}"]))
                ET.SubElement(cord, "site", site=f"spring{k}{end}")
        rows = ET.SubElement(top, "equality") if tree["cuts"] else top
        for cut in tree["cuts"]:
            ends = {f"body{n}": "world" if cut[e] == GROUND else f"body{cut[e]}" for n, e in ((1, "i"), (2, "j"))}
            ET.SubElement(rows, "connect", {"anchor": _text(cut["s_i"])} | ends)
        key = ET.SubElement(top, "keyframe")
        ET.SubElement(key, "key", name="start", qpos=_text(tree["start"]), qvel=_text(tree["start_velocity"]))
        assert len(parts) == system.nb + 1
        return ET.tostring(top, encoding="unicode")

    @property
    def floats(self) -> bool:
        """True if the first body is free: it is the base of the URDF then, else the ground is."""
        return bool(self.tree["limbs"][0]["kind"] == FREE)

    @cached_property
    def urdf(self) -> str:
        """URDF of the tree, with the joint ``spherical`` of Bullet; joints have the names of their bodies."""
        top = ET.Element("robot", name=self.name)
        if self.problem.system.torsion_k.size or self.tree["springs"]:
            raise ValueError(f"{self.name}: URDF has no springs; use the numbers or the MJCF")
        if not self.floats:
            ET.SubElement(top, "link", name="ground")
        for x in self.links:
            name = f"body{x['body']}"
            inertial = ET.SubElement(ET.SubElement(top, "link", name=name), "inertial")
            ET.SubElement(inertial, "origin", xyz=_text(x["centre"]))
            ET.SubElement(inertial, "mass", value=_text([x["mass"]]))
            J = {f"i{'xyz'[m]}{'xyz'[n]}": _text([x["inertia"][m, n]]) for m in range(3) for n in range(m, 3)}
            ET.SubElement(inertial, "inertia", J)
            if x["kind"] == FREE:
                continue
            kinds = {Kind.HINGE.name: "continuous", Kind.SLIDE.name: "prismatic", Kind.BALL.name: "spherical"}
            if x["kind"] not in kinds:
                raise ValueError(f"{self.name}: URDF has no {x['kind'].lower()} joint; use the numbers or the MJCF")
            joint = ET.SubElement(top, "joint", name=name, type=kinds[x["kind"]])
            ET.SubElement(joint, "parent", link="ground" if x["parent"] == GROUND else f"body{x['parent']}")
            ET.SubElement(joint, "child", link=name)
            rpy = Rotation.from_matrix(x["R_0"]).as_euler("xyz", suppress_warnings=True)
            ET.SubElement(joint, "origin", xyz=_text(x["at"]), rpy=_text(rpy))
            ET.SubElement(joint, "axis", xyz=_text(x["axes"][0] if x["axes"] else (1.0, 0.0, 0.0)))
        return ET.tostring(top, encoding="unicode")


def _text(numbers: Iterable[float]) -> str:
    """Return numbers as text of an XML attribute, with all digits."""
    return " ".join(repr(float(x)) for x in numbers)


def _quaternion(R: np.ndarray) -> str:
    """Return a rotation matrix as the text of its quaternion w, x, y, z."""
    return _text(Rotation.from_matrix(R).as_quat(scalar_first=True))
