"""Convert a tree to the dictionary of names and numbers that an engine of ``inside`` builds its model from."""

from dataclasses import fields
from typing import Any

import numpy as np

from ..state import State, States
from ..system import MultibodySystem
from ..torsion import evaluate_torsion
from .tree import PARALLEL, EngineTree, Kind


def flatten_tree(tree: EngineTree, system: MultibodySystem, start: State) -> dict[str, Any]:
    """Return the model of a system as names and numbers: gravity, limbs, cuts, links, springs, loads and the start.

    Limbs have ``torsion`` and ``drive`` of their hinge, or None. Points and axes are in body frames, gravity and the
    ``r``, ``v`` of limbs in space; a load is in space unless it ``follows``. Raises ValueError as
    ``list_hinge_springs`` does.
    """
    torsions = list_hinge_springs(system, start, tree)
    drives = {drive.body: {"name": drive.name, "motion": drive.motion} for drive in tree.drives}
    limbs = [
        {
            **{f.name: getattr(limb, f.name) for f in fields(limb)},
            "kind": limb.kind.name,
            "moves": limb.list_moves(),
            "mass": system.mass[limb.body],
            "inertia": system.regular_inertia[limb.body],
            "torsion": torsions.get(limb.body),
            "drive": drives.get(limb.body),
            **{name: getattr(start, name)[limb.body] for name in MOTION},
        }
        for limb in tree.limbs
    ]
    springs = [
        {
            "i": system.spring_i[k],
            "p_i": system.spring_p_i[k],
            "j": system.spring_j[k],
            "p_j": system.spring_p_j[k],
            "stiffness": system.spring_k[k],
            "damping": system.spring_c[k],
            "rest_length": system.spring_d0[k],
        }
        for k in range(len(system.spring_k))
    ]
    cuts, links = (
        [{f.name: getattr(one, f.name) for f in fields(one)} for one in of] for of in (tree.cuts, tree.links)
    )
    loads = [
        {
            "body": system.load_i[k],
            "point": system.load_p[k],
            "force": system.load_force[k],
            "torque": system.load_torque[k],
            "follows": bool(system.load_follows[k]),
            "factor": system.load_factor[k],
        }
        for k in range(len(system.load_i))
    ]
    return {
        "gravity": system.gravity,
        "limbs": limbs,
        "cuts": cuts,
        "links": links,
        "springs": springs,
        "loads": loads,
        "start": tree.start,
        "start_velocity": tree.start_velocity,
    }


MOTION = ("r", "R", "v", "Omega")


def list_hinge_springs(system: MultibodySystem, start: State, tree: EngineTree) -> dict[int, dict[str, float]]:
    """Return stiffness, rest angle and damping of each torsional spring, by the child body of its hinge.

    They are in N m/rad, rad and N m s/rad; the rest angle is that of the hinge, whose angle is 0 at the start. Raise
    ValueError for a spring not about the axis of a hinge of the tree, and for a second one on the same hinge.
    """
    out: dict[int, dict[str, float]] = {}
    stretched = evaluate_torsion(system, States.one(start))[0][0]
    limbs = {limb.body: limb for limb in tree.limbs if limb.kind is Kind.HINGE}
    for k, (i, j) in enumerate(zip(system.torsion_i.tolist(), system.torsion_j.tolist(), strict=True)):
        axis = np.cross(*system.torsion_n[k])  # in j
        child = next((b for b in (i, j) if b in limbs and {b, limbs[b].parent} == {i, j}), None)
        along = 0.0
        if child is not None:
            along = float(limbs[child].axis @ (limbs[child].R_0.T @ axis if child == i else -axis))
        if child is None or abs(abs(along) - 1.0) > PARALLEL or child in out:
            raise ValueError("a torsional spring is not about the axis of a hinge of the tree")
        rest = -float(np.sign(along)) * float(stretched[k])
        stiffness, damping = float(system.torsion_k[k]), float(system.torsion_c[k])
        out[child] = {"stiffness": stiffness, "rest_angle": rest, "damping": damping}
    return out
