"""Problems that try every part of an export: loops, both kinds of joints, floating bodies, springs, redundant rows."""

from mbsbench import Joint, Problem, RigidBody, SpringDamper, TimeFunction, assemble, make_problem
from mbsbench.harness.mechanics.forces import TorsionSpring
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.mechanics.system import GROUND, Load

from ...harness.reference.mechanisms import problem, slider_crank, sprung
from ..arbitrary_systems import consistent, linkage


def closed_chain() -> Problem:
    """Spherical and revolute joints in a loop, springs and dampers, tilted inertias, moving."""
    system = linkage(springs=True)
    return problem("closed_chain", system, consistent(system, 3), 0.5)


def grid() -> Problem:
    """Two by two: redundant rows, revolute loops."""
    return make_problem("four_bar_grid", {"rows": 2, "columns": 2, "t_end": 0.5, "rotation": (0.3, -0.5, 0.7)})


def duplicated() -> Problem:
    """The second joint is declared twice."""
    made = make_problem("four_bar_grid", {"rows": 1, "columns": 1, "t_end": 0.5})
    return problem("duplicated", Presentation(duplicate=2).system(made.system), made.initial, 0.5)


def perturbed_chain() -> Problem:
    """Bars out of their plane."""
    return make_problem("chain", {"perturb": 0.1, "t_end": 0.1})


def sliding() -> Problem:
    """A slide, a universal joint, a cylinder and a weld in a loop that a spherical joint closes, moving."""
    bodies = linkage(springs=False)
    parts = [RigidBody(m, J) for m, J in zip((*bodies.mass, 0.9), (*bodies.inertia, bodies.inertia[0]), strict=True)]
    a, b, c = (1.0, 2.0, 3.0), (0.5, -1.0, 0.2), (0.0, 1.0, 1.0)
    joints = [
        Joint(2, (-0.2, 0.0, 0.1), s_j=(0.4, 0.5, -0.6)),
        Joint(0, (0.3, 0.1, 0.0), GROUND, (0.1, -0.2, 0.3), a, b, kind="prismatic", across_i=c, across_j=a),
        Joint(1, (0.2, 0.0, -0.3), 0, (-0.4, 0.1, 0.2), a, c, kind="universal"),
        Joint(1, (-0.3, 0.2, 0.0), 2, (0.1, 0.2, 0.3), b, a, kind="cylindrical"),
        Joint(3, (0.1, 0.1, 0.1), 2, (0.0, 0.2, 0.0), c, b, kind="fixed", across_i=a, across_j=c),
    ]
    spring = SpringDamper(0, (0.2, 0.1, -0.1), 3, (0.0, 0.3, 0.1), stiffness=30.0, rest_length=0.4, damping=2.0)
    system = assemble(parts, joints, (1.1, -2.3, -9.5), [spring])
    return problem("sliding", system, consistent(system, 3), 0.5)


def jointed(*, plain: bool) -> Problem:
    """An open chain of a slide, a ball joint or a universal one, a hinge or a cylinder, and a weld, moving."""
    pose, a, b, c = linkage(springs=False), (1.0, 2.0, 3.0), (0.5, -1.0, 0.2), (0.0, 1.0, 1.0)
    inertias = (*pose.inertia, pose.inertia[0])
    parts = [RigidBody(m, J) for m, J in zip((*pose.mass, 0.9), inertias, strict=True)]
    kinds = ("spherical", "revolute") if plain else ("universal", "cylindrical")
    joints = [
        Joint(0, (0.3, 0.1, 0.0), GROUND, (0.1, -0.2, 0.3), a, b, kind="prismatic", across_i=c, across_j=a),
        Joint(1, (0.2, 0.0, -0.3), 0, (-0.4, 0.1, 0.2), *((None, None) if plain else (a, c)), kind=kinds[0]),
        Joint(2, (0.1, 0.2, 0.3), 1, (-0.3, 0.2, 0.0), b, a, kind=kinds[1]),
        Joint(3, (0.1, 0.1, 0.1), 2, (0.0, 0.2, 0.0), c, b, kind="fixed", across_i=a, across_j=c),
    ]
    system = assemble(parts, joints, (1.1, -2.3, -9.5))
    return problem("jointed", system, consistent(system, 3), 0.2)


def loaded(*, varying: bool) -> Problem:
    """A chain of tilted bodies on a ball joint and a hinge, pushed off its centres in space and in a body, moving."""
    factor = TimeFunction((0.3, 0.4, -0.2, 0.1), 0.2, 5.0, 0.7) if varying else TimeFunction((0.7,))
    bodies = linkage(springs=False)
    parts = [RigidBody(m, J) for m, J in zip(bodies.mass[:2], bodies.inertia[:2], strict=True)]
    joints = [
        Joint(0, (0.3, 0.1, 0.0), GROUND, (0.1, -0.2, 0.3)),
        Joint(1, (0.2, 0.0, -0.3), 0, (-0.4, 0.1, 0.2), (1.0, 2.0, 3.0), (0.5, -1.0, 0.2)),
    ]
    loads = [
        Load(0, (1.0, 2.0, -1.0), (0.3, 0.1, -0.2), (0.1, -0.2, 0.3), factor=factor),
        Load(1, (0.5, -0.4, 0.3), (-0.2, 0.3, 0.5), (0.2, 0.1, 0.0), follows=True, factor=factor),
        Load(1, torque=(0.2, 0.1, -0.4)),
    ]
    system = assemble(parts, joints, (1.1, -2.3, -9.5), loads=loads)
    return problem("loaded", system, consistent(system, 3), 0.5)


def driven() -> Problem:
    """A driven slide, a hinge whose drive is declared in the other order of ends, and a ball joint, moving."""
    a, b, c, pose = (1.0, 2.0, 3.0), (0.5, -1.0, 0.2), (0.0, 1.0, 1.0), linkage(springs=False)
    parts = [RigidBody(m, J) for m, J in zip(pose.mass, pose.inertia, strict=True)]
    way, turn = TimeFunction((0.1, 0.4, -0.2, 0.7)), TimeFunction((0.3,), 0.5, 4.0, -0.4)
    joints = [
        Joint(0, (0.3, 0.1, 0.0), GROUND, (0.1, -0.2, 0.3), a, b, kind="prismatic", across_i=c, across_j=a),
        Joint(0, (0.3, 0.1, 0.0), GROUND, (0.1, -0.2, 0.3), axis_j=b, name="way", kind="driven position", motion=way),
        Joint(1, (0.2, 0.0, -0.3), 0, (-0.4, 0.1, 0.2), a, c),
        Joint(0, (-0.4, 0.1, 0.2), 1, (0.2, 0.0, -0.3), c, a, "turn", "driven angle", b, c, motion=turn),
        Joint(2, (-0.3, 0.2, 0.0), 1, (0.1, 0.2, 0.3)),
    ]
    system = assemble(parts, joints, (1.1, -2.3, -9.5))
    return problem("driven", system, consistent(system, 3), 0.2)


def guided() -> Problem:
    """A bead on a wire, a body on a ball joint, and one at the end of a rod, moving."""
    pose = linkage(springs=False)
    parts = [RigidBody(m, J) for m, J in zip(pose.mass, pose.inertia, strict=True)]
    joints = [
        Joint(0, (0.3, 0.1, 0.0), GROUND, (0.1, -0.2, 0.3), axis_j=(0.5, -1.0, 0.2), kind="point on line"),
        Joint(1, (0.2, 0.0, -0.3), 0, (-0.4, 0.1, 0.2)),
        Joint(2, (0.1, 0.2, 0.3), 1, (-0.3, 0.2, 0.0), kind="distance", length=0.7),
    ]
    system = assemble(parts, joints, (1.1, -2.3, -9.5))
    return problem("guided", system, consistent(system, 3), 0.3)


def tilting() -> Problem:
    """A foot on a plane, an arm normal to a direction of it, and a hinge with a torsional spring and damper, moving."""
    pose, b, c = linkage(springs=False), (0.5, -1.0, 0.2), (0.0, 1.0, 1.0)
    parts = [RigidBody(m, J) for m, J in zip(pose.mass, pose.inertia, strict=True)]
    joints = [
        Joint(0, (0.2, 0.0, -0.3), GROUND, (-0.4, 0.1, 0.2), axis_j=c, kind="point on plane"),
        Joint(1, (0.0, 0.0, 0.0), 0, (0.0, 0.0, 0.0), (1.0, 2.0, 3.0), b, kind="normal axes"),
        Joint(2, (0.1, 0.1, 0.1), 1, (0.0, 0.2, 0.0), c, b),
    ]
    spring = TorsionSpring(1, (0.2, 0.0, -0.5), 2, c, (1.0, 0.0, 0.0), stiffness=3.0, rest_angle=0.4, damping=0.2)
    system = assemble(parts, joints, (1.1, -2.3, -9.5), torsions=[spring])
    return problem("tilting", system, consistent(system, 3), 0.3)


PROBLEMS = {
    f.__name__: f for f in (closed_chain, grid, duplicated, perturbed_chain, sliding, driven, guided, tilting)
} | {
    "slider_crank": lambda: slider_crank(hinged=True),
    "sprung": lambda: sprung(0.7),
    "loaded": lambda: loaded(varying=False),
    "loaded_in_time": lambda: loaded(varying=True),
    "jointed": lambda: jointed(plain=True),
    "jointed_otherwise": lambda: jointed(plain=False),
    "rolling": lambda: make_problem("rolling_disc", {"rotation": (0.3, -0.5, 0.7)}),
}
