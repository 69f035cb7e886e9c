"""Read files of mechanisms; MuJoCo's parser and compiler read MJCF and URDF (extra ``engines``).

Meshes become points before the compiler sees them, so that their files may be missing while elements that refer to them
stay. Module ``urdf`` has what URDF needs in addition. SDFormat and USD have separate readers (modules ``sdformat`` and
``usd``).
"""

import hashlib
import importlib
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...base.confined_paths import read_whole
from ...catalogue.mechanism import MechanismFile, choose_name
from . import sdformat, urdf, usd
from .closing import close_joints
from .links import LinkMechanism
from .mechanism import (
    CompiledMechanism,
    OmittedContents,
    describe_locked_joints,
    find_joints,
    is_straight_spring,
)
from .mujoco_bodies import correct_inertia, group_bodies
from .mujoco_flags import apply_flags

COMPILED = (".xml", ".mjcf", ".urdf")  # extensions of files that MuJoCo's compiler reads
READERS = (sdformat, usd)  # our own readers, each with its extensions
COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
# a file that an MJCF file includes or attaches
INCLUDE = re.compile(rb"<(?:include|model)\b[^>]*?\bfile\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
ROOT = re.compile(rb"<\s*([A-Za-z_][\w:.-]*)")  # first tag of an XML file, after declarations and comments
SUFFIXES = (*COMPILED, *(suffix for reader in READERS for suffix in reader.SUFFIXES))


def list_files(path: Path) -> tuple[Path, ...]:
    """Return the file and those that it includes, on which its motion depends; meshes are not among them."""
    if path.suffix.lower() in usd.SUFFIXES:
        return usd.list_layers(path)
    found = [path]
    for file in found if path.suffix.lower() in COMPILED else ():
        found += [p for p in _list_included(file, path) if p not in found]
    return tuple(found)


def _list_included(file: Path, first: Path) -> Iterator[Path]:
    """Yield the existing files that the MJCF ``file`` names: beside it or, as in MuJoCo, beside the ``first`` file."""
    text = COMMENT.sub(b"", read_whole(file))
    for match in INCLUDE.finditer(text):
        name = (match[1] or match[2]).decode(errors="replace")
        yield from [p for p in (file.parent / name, first.parent / name) if p.is_file()][:1]


def read_mechanism(path: Path) -> MechanismFile:
    """Return the mechanism in a file in any of the formats (``SUFFIXES``).

    Raise ValueError with a message of one line if it cannot be read, or if a joint or loop is not supported.
    """
    if not path.is_file():
        raise ValueError("there is no such file")
    suffix = path.suffix.lower()
    reader = next((r for r in READERS if suffix in r.SUFFIXES), None)
    out = _read_links(path, reader) if reader else _compile_file(path)
    out.system()  # raises ValueError for joints and loops that are not supported
    return out


def _read_links(path: Path, reader: Any) -> LinkMechanism:
    """Return the mechanism in a file that ``reader``, one of the modules ``READERS``, reads as links and joints.

    Joints of loops that rounding leaves open are closed. Raise ValueError if nothing can move.
    """
    found = reader.Document(path)
    if not found.links:
        raise ValueError("nothing in it can move: no body is free or has a joint")
    joints = close_joints(found.joints)
    source = found.reader + describe_locked_joints(found.locked)
    omitted = {what: n for what, n in found.omitted.items() if n}
    return LinkMechanism(
        choose_name(path), path, digest_mechanism(path), source, found.links, joints, found.gravity, found.dt, omitted
    )


def _compile_file(path: Path) -> CompiledMechanism:
    """Return the mechanism in an MJCF or URDF file as MuJoCo compiles it, without the files of meshes and textures.

    Raise ValueError with a message of one line if MuJoCo or this reader refuses it, or if nothing can move.
    """
    try:
        mj = importlib.import_module("mujoco")
    except ImportError:
        raise ValueError("MuJoCo reads such files and is not installed: pip install 'mbsbench[mujoco]'") from None
    root = _read_root_tag(path)
    robot = urdf.UrdfDocument(path) if root in (b"robot", b"") else None
    try:
        spec = mj.MjSpec.from_string(robot.text) if robot else mj.MjSpec.from_file(str(path))
        if robot and spec.compiler.inertiafromgeom == mj.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
            raise ValueError("inertiafromgeom is not supported in a URDF: its inertias are those of its links")
        if robot:
            spec.compiler.fusestatic = robot.fuses  # which loses inertias of links without mass
        _remove_visuals(mj, spec)
        for body in spec.bodies:
            correct_inertia(mj, body)
        with warnings.catch_warnings():  # warnings about motions, which are not computed by MuJoCo here
            warnings.simplefilter("ignore", UserWarning)
            model = spec.compile()
    except ValueError as error:  # MuJoCo's messages have several lines
        message = " ".join(str(error).split()).partition(" The static bodies of the spec were fused")[0]
        raise ValueError(robot.explain_error(message) if robot else message) from None
    apply_flags(mj, model)
    if not np.any(group_bodies(model)):
        raise ValueError(f"nothing in it can move: {robot.at_rest if robot else 'no body has a joint'}")
    omitted = {what: n for what, n in _count_omitted(mj, model).items() if n}
    more = {} if robot is None else {what: n for what, n in robot.omitted.items() if n}
    return CompiledMechanism(
        choose_name(path), path, digest_mechanism(path), mj, model, omitted | more, robot.locked if robot else 0
    )


def _read_root_tag(path: Path) -> bytes:
    """Return the tag of the first element of an XML file, such as ``robot`` or ``mujoco``; empty if there is none."""
    found = ROOT.search(COMMENT.sub(b"", read_whole(path)))
    return found[1] if found else b""


def digest_mechanism(path: Path) -> str:
    """Return the first 12 hexadecimal digits of the SHA-256 of the file and of all that it includes."""
    return hashlib.sha256(b"\0".join(read_whole(p) for p in list_files(path))).hexdigest()[:12]


def _remove_visuals(mj: Any, spec: Any) -> None:
    """Replace meshes of a MuJoCo ``spec`` by points and remove textures, in place, since their files may be missing.

    Raise ValueError for flexible bodies, plugins, and moving bodies whose inertia is computed from a mesh.
    """
    if spec.flexes or spec.plugins:
        raise ValueError("flexible bodies and plugins of MuJoCo are not supported")
    from_geoms = spec.compiler.inertiafromgeom
    for geom in list(spec.geoms):
        if not geom.meshname and not geom.hfieldname:
            continue
        body = geom.parent
        given = body.explicitinertial and from_geoms != mj.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        if not given and _is_moving(spec, body) and from_geoms != mj.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE:
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


def _is_moving(spec: Any, body: Any) -> bool:
    """Return whether the body, or one of its ancestors, has a joint."""
    while body.name != spec.worldbody.name:
        if body.joints:
            return True
        body = body.parent
    return False


def _count_omitted(mj: Any, m: Any) -> dict[OmittedContents, int]:
    """Count by kind the contents of MuJoCo's model ``m`` that have no counterpart here; counts may be 0."""
    straight = sum(is_straight_spring(mj, m, k) for k in range(m.ntendon))
    included = find_joints(mj, m)
    return {
        OmittedContents.ACTUATORS: m.nu,
        OmittedContents.COLLIDING: _count_colliding(mj, m),
        OmittedContents.LIMITS: int(np.sum(m.jnt_limited) + np.sum(m.tendon_limited)),
        OmittedContents.STIFFNESS: _count_nonzero_rows(m.jnt_stiffness, m.jnt_stiffnesspoly)
        - len(included.turning_springs)
        - len(included.sliding_springs),
        OmittedContents.DAMPING: _count_nonzero_rows(m.dof_damping, m.dof_dampingpoly)
        - len(included.turning_dampers)
        - len(included.sliding_dampers),
        OmittedContents.FRICTION: _count_nonzero_rows(m.dof_frictionloss) + _count_nonzero_rows(m.tendon_frictionloss),
        OmittedContents.ARMATURE: _count_nonzero_rows(m.dof_armature)
        - len(included.armatures)
        + _count_nonzero_rows(m.tendon_armature),
        OmittedContents.LIFT: _count_nonzero_rows(m.body_gravcomp),
        OmittedContents.FLUID: int(m.opt.density != 0.0 or m.opt.viscosity != 0.0),
        OmittedContents.TENDONS: m.ntendon - straight,
        OmittedContents.MOCAP: m.nmocap,
        OmittedContents.ASLEEP: _count_asleep(mj, m),
    }


def _count_colliding(mj: Any, m: Any) -> int:
    """Count the geoms that may touch another one, by their contact bits or by an explicit pair."""
    off = mj.mjtDisableBit.mjDSBL_CONTACT | mj.mjtDisableBit.mjDSBL_CONSTRAINT
    collides = (m.geom_contype | m.geom_conaffinity) != 0
    if not m.opt.disableflags & off:
        collides[m.pair_geom1] = collides[m.pair_geom2] = True
    return int(np.sum(collides))


def _count_asleep(mj: Any, m: Any) -> int:
    """Count the bodies that sleep from the start until something wakes them, in versions of MuJoCo that have sleep."""
    if not m.opt.enableflags & getattr(mj.mjtEnableBit, "mjENBL_SLEEP", 0):
        return 0
    asleep = m.tree_sleep_policy == int(mj.mjtSleepPolicy.mjSLEEP_INIT)
    return int(np.sum(asleep[m.body_treeid[m.body_treeid >= 0]]))


def _count_nonzero_rows(*values: np.ndarray) -> int:
    """Count the indices k for which ``v[k]``, a number or a row, is not zero in at least one array v of ``values``."""
    return int(np.sum(np.any([np.any(np.atleast_2d(v.T) != 0.0, axis=0) for v in values], axis=0)))
