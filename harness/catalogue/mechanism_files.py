"""Files of mechanisms: MuJoCo's own parser and compiler read MJCF and URDF (extra ``engines``).

Meshes become points before the compiler sees them, so that their files need not be there while what refers to them
stays. What URDF needs beside that is in module ``urdf``. SDFormat and USD have readers of their own (modules
``sdformat`` and ``usd``).
"""

import hashlib
import importlib
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..places import read_whole
from . import sdformat, urdf, usd
from .closing import close_joints
from .links import LinkMechanism
from .mechanism import NO_INERTIA, CompiledMechanism, Mechanism, Omitted, find_joints, is_straight_spring
from .mujoco_flags import apply_flags

COMPILED, SDFORMAT, USD = (".xml", ".mjcf", ".urdf"), (".sdf", ".world"), (".usd", ".usda", ".usdc", ".usdz")
COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
INCLUDE = re.compile(rb"<(?:include|model)\b[^>]*?\bfile\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
ROOT = re.compile(rb"<\s*([A-Za-z_][\w:.-]*)")  # of an XML file: its first tag behind declarations and comments
SUFFIXES = (*COMPILED, *SDFORMAT, *USD)


def is_mechanism(name: str) -> bool:
    """Whether ``name`` means a file of a mechanism."""
    return Path(name).suffix.lower() in SUFFIXES


def name_of(path: str | Path) -> str:
    """The name of a file's problem, in letters that need no quotes."""
    return re.sub(r"[^\w+-]+", "_", Path(path).stem)


def files(path: Path) -> tuple[Path, ...]:
    """The file and those that it includes: all that a motion depends on (inertias of meshes are refused)."""
    if path.suffix.lower() in USD:
        return usd.layers(path)
    found = [path]
    for here in found if path.suffix.lower() in COMPILED else ():
        found += [p for p in _included(here, path) if p not in found]
    return tuple(found)


def _included(here: Path, top: Path) -> Iterator[Path]:
    """Files that a file of MuJoCo's names, beside it or beside the first one, where MuJoCo looks for them."""
    text = COMMENT.sub(b"", read_whole(here))
    for match in INCLUDE.finditer(text):
        name = (match[1] or match[2]).decode(errors="replace")
        yield from [p for p in (here.parent / name, top.parent / name) if p.is_file()][:1]


def read(path: Path) -> Mechanism:
    """The file, or ValueError in one line."""
    if not path.is_file():
        raise ValueError("there is no such file")
    suffix = path.suffix.lower()
    out = _compile_file(path) if suffix in COMPILED else _read_links(path, sdformat if suffix in SDFORMAT else usd)
    out.system()  # refuses joints and loops that are not taken over
    return out


def _read_links(path: Path, reader: Any) -> LinkMechanism:
    found = reader.Document(path)
    if not found.links:
        raise ValueError("nothing in it can move: no body is free or has a joint")
    joints = close_joints(found.joints)
    return LinkMechanism(name_of(path), path, _digest(path), found.reader, found.links, joints, found.gravity,
                         found.dt, {what: n for what, n in found.omitted.items() if n})  # fmt: skip


def _compile_file(path: Path) -> CompiledMechanism:
    try:
        mj = importlib.import_module("mujoco")
    except ImportError:
        raise ValueError("MuJoCo reads such files and is not installed: pip install 'mbsbench[engines]'") from None
    robot = urdf.Document(path) if _root(path) == b"robot" else None
    try:
        spec = mj.MjSpec.from_string(robot.text) if robot and robot.text else mj.MjSpec.from_file(str(path))
        _without_looks(mj, spec)
        for body in spec.bodies:  # slender rods and point masses
            if body.explicitinertial and np.isnan(body.fullinertia[0]):
                body.inertia = np.where(body.inertia == 0.0, NO_INERTIA, body.inertia)
        with warnings.catch_warnings():  # about motions, which are not MuJoCo's here
            warnings.simplefilter("ignore", UserWarning)
            model = spec.compile()
    except ValueError as error:  # of MuJoCo, over several lines
        message = " ".join(str(error).split()).partition(" The static bodies of the spec were fused")[0]
        raise ValueError(robot.explain(message) if robot else message) from None
    apply_flags(mj, model)
    if not set(model.body_weldid) - {0}:
        raise ValueError("nothing in it can move: no body has a joint")
    omitted = {what: n for what, n in _count_omitted(mj, model).items() if n}
    more = {} if robot is None else {what: n for what, n in robot.omitted.items() if n}
    return CompiledMechanism(name_of(path), path, _digest(path), mj, model, omitted | more)


def _root(path: Path) -> bytes:
    found = ROOT.search(COMMENT.sub(b"", read_whole(path)))
    return found[1] if found else b""


def _digest(path: Path) -> str:
    return hashlib.sha256(b"\0".join(read_whole(p) for p in files(path))).hexdigest()[:12]


def _without_looks(mj: Any, spec: Any) -> None:
    """Meshes become points and textures are left out: their files need not be there; no inertia may come from them."""
    if spec.flexes or spec.plugins:
        raise ValueError("flexible bodies and plugins of MuJoCo are not taken over")
    from_geoms = spec.compiler.inertiafromgeom
    for geom in list(spec.geoms):
        if not geom.meshname and not geom.hfieldname:
            continue
        body = geom.parent
        given = body.explicitinertial and from_geoms != mj.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        if not given and _moves(spec, body) and from_geoms != mj.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE:
            raise ValueError(f"body {body.name!r} has its inertia from a mesh; give it mass and inertia as numbers")
        geom.type, geom.meshname, geom.hfieldname, geom.mass = mj.mjtGeom.mjGEOM_SPHERE, "", "", 0.0
        geom.size, geom.fromto = [1e-3, 0.0, 0.0], [np.nan] * 6
    for part in (*spec.geoms, *spec.sites, *spec.tendons):
        part.material = ""
    for light in spec.lights:
        light.texture = ""
    for kind in ("skins", "meshes", "hfields", "materials", "textures"):
        for part in list(getattr(spec, kind)):
            spec.delete(part)


def _moves(spec: Any, body: Any) -> bool:
    while body.name != spec.worldbody.name:
        if body.joints:
            return True
        body = body.parent
    return False


def _count_omitted(mj: Any, m: Any) -> dict[Omitted, int]:
    straight = sum(is_straight_spring(mj, m, k) for k in range(m.ntendon))
    ours = find_joints(mj, m)
    return {
        Omitted.ACTUATORS: m.nu,
        Omitted.COLLIDING: int(np.sum((m.geom_contype | m.geom_conaffinity) != 0)),
        Omitted.LIMITS: int(np.sum(m.jnt_limited) + np.sum(m.tendon_limited)),
        Omitted.STIFFNESS: _some(m.jnt_stiffness, m.jnt_stiffnesspoly)
        - len(ours.turning_springs)
        - len(ours.sliding_springs),
        Omitted.DAMPING: _some(m.dof_damping, m.dof_dampingpoly)
        - len(ours.turning_dampers)
        - len(ours.sliding_dampers),
        Omitted.FRICTION: _some(m.dof_frictionloss) + _some(m.tendon_frictionloss),
        Omitted.ARMATURE: _some(m.dof_armature) - len(ours.armatures) + _some(m.tendon_armature),
        Omitted.LIFT: _some(m.body_gravcomp),
        Omitted.FLUID: int(m.opt.density != 0.0 or m.opt.viscosity != 0.0),
        Omitted.TENDONS: m.ntendon - straight,
    }


def _some(*values: np.ndarray) -> int:
    """How many rows are not zero."""
    return int(np.sum(np.any([np.any(np.atleast_2d(v.T) != 0.0, axis=0) for v in values], axis=0)))
