"""Compare a mechanism that a reader has made of a URDF with what Pinocchio makes of it, as ``other_models`` does."""

import importlib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from other_models import NEAR, STATES, NotComparableError, Sample  # type: ignore[import-not-found]  # beside this file

from mbsbench.harness.formats.mechanisms.mechanism import CompiledMechanism
from mbsbench.harness.mechanics.state import State


class PinocchioModel:
    """A Pinocchio model of a URDF with its first link fixed to the ground, and joints of equal limits locked."""

    def __init__(self, path: Path) -> None:
        """Read the file; raise NotComparableError if Pinocchio does not."""
        self.pin, self.left_out = importlib.import_module("pinocchio"), 0
        tree = _reduce_urdf(ET.fromstring(path.read_bytes().lstrip()))
        joints = tree.findall("joint")
        try:
            model = self.pin.buildModelFromXML(ET.tostring(tree, encoding="unicode"))
        except (ValueError, RuntimeError) as error:
            raise NotComparableError(" ".join(str(error).split())) from None
        limited = {
            joint.get("name")
            for joint in joints
            if any({"lower", "upper"} & {*limit.keys()} for limit in joint.findall("limit"))
        }
        locked = [
            k
            for k in range(1, model.njoints)
            if model.joints[k].nq == 1
            and model.names[k] in limited
            and model.lowerPositionLimit[model.joints[k].idx_q] == model.upperPositionLimit[model.joints[k].idx_q]
        ]
        self.model = self.pin.buildReducedModel(model, locked, self.pin.neutral(model)) if locked else model
        self.links = {j.get("name"): j.find("child").get("link") for j in joints}  # type: ignore[union-attr]

    def remove(self, omitted: set[str]) -> None:
        """Take away what a reader names as omitted; Pinocchio has no dry friction, limits or contacts by itself."""

    def make_samples(self, mechanism: CompiledMechanism, rng: np.random.Generator) -> Iterator[Sample]:
        """Yield the start and random states, with damping of joints as the file states it."""
        pin, model, problem = self.pin, self.model, mechanism.problem()
        numbers = {self.links[model.names[k]]: k for k in range(1, model.njoints)}
        joints = [numbers[name] for name in problem.system.body_names]
        data = model.createData()
        for k in range(1 + STATES):
            q, v = pin.neutral(model), np.zeros(model.nv)
            if k:
                q = pin.integrate(model, q, rng.uniform(-NEAR, NEAR, model.nv))
                v = rng.uniform(-NEAR, NEAR, model.nv)
            a = pin.aba(model, data, q, v, -model.damping * v)
            pin.forwardKinematics(model, data, q, v, a)
            R = np.array([data.oMi[j].rotation for j in joints])
            C = np.array([model.inertias[j].lever for j in joints])
            r = np.array([data.oMi[j].translation for j in joints]) + np.einsum("bij,bj->bi", R, C)
            w, w_dot = (np.array([s[j].angular for j in joints]) for s in (data.v, data.a))
            u, u_dot = (np.array([s[j].linear for j in joints]) for s in (data.v, data.a))
            u_C = u + np.cross(w, C)
            state = State(r, R, np.einsum("bij,bj->bi", R, u_C), w)
            # of the centre of mass, from the spatial acceleration of the frame's origin
            at = np.einsum("bij,bj->bi", R, u_dot + np.cross(w_dot, C) + np.cross(w, u_C))
            yield Sample(problem.system, state if k else problem.initial, state, at, w_dot)


def _reduce_urdf(tree: ET.Element) -> ET.Element:
    """Return a URDF without what Pinocchio would refuse although it changes no motion: looks, names, limits of effort.

    Blanks around numbers, by which Pinocchio drops an inertial, mean nothing in XML.
    """
    for e in tree.iter():
        e.attrib = {name: " ".join(value.split()) for name, value in e.attrib.items()}
        for part in [part for part in e if part.tag in ("material", "visual", "collision")]:
            e.remove(part)
    for k, joint in enumerate(tree.findall("joint")):
        joint.set("name", f"joint {k}")  # it may be called as a link is
        for limit in joint.findall("limit"):
            limit.attrib = {"effort": "0", "velocity": "0"} | limit.attrib
    return tree
