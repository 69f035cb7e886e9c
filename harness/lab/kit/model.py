"""Define the model that the kit gives to an engine: the problem as numbers, as MJCF or as URDF, and a step."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...catalogue.description import describe_problem
from ...mechanics.cut_trees.mjcf import format_numbers, write_mjcf
from ...mechanics.cut_trees.plain import flatten_tree
from ...mechanics.cut_trees.tree import Kind, build_spanning_tree
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
        return write_mjcf(self.tree, self.dt, "body{}".format)

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
            ET.SubElement(inertial, "origin", xyz=format_numbers(x["centre"]))
            ET.SubElement(inertial, "mass", value=format_numbers([x["mass"]]))
            J = {f"i{'xyz'[m]}{'xyz'[n]}": format_numbers([x["inertia"][m, n]]) for m in range(3) for n in range(m, 3)}
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
            ET.SubElement(joint, "origin", xyz=format_numbers(x["at"]), rpy=format_numbers(rpy))
            ET.SubElement(joint, "axis", xyz=format_numbers(x["axes"][0] if x["axes"] else (1.0, 0.0, 0.0)))
        return ET.tostring(top, encoding="unicode")
