"""The equations of a mechanism as expressions, for experiments that differentiate or expand them: ``WRITER``."""

from ....harness.mechanics.joint_expressions import ExpressionWriter, JointExpressions
from ....harness.mechanics.joint_tree import Tree
from ....harness.mechanics.system import MultibodySystem
from .code import MechanismFunctions, choose_equations, digest_mechanism, make_code, write_equations
from .counting import refuse_code


def digest_equations(system: MultibodySystem, tree: Tree) -> str:
    """Return the digest of a mechanism's equations; make its code, and raise ValueError as ``make_code`` does."""
    make_code(system, tree)
    return digest_mechanism(system, tree)


def write_expressions(system: MultibodySystem, tree: Tree) -> JointExpressions:
    """Return rates, poses, inertia H and rows of a mechanism as CasADi expressions in t and y.

    Accelerations are those of the code, in which all or none of the spherical joints are opened; H and the rows are
    those without opened joints. Raises ValueError as ``make_code`` does.
    """
    import casadi as ca

    make_code(system, tree)
    t, y = ca.SX.sym("t"), ca.SX.sym("y", tree.nq + tree.nu)
    chosen, whole = choose_equations(system, tree, t, y), write_equations(system, tree, t, y, [])
    parts = MechanismFunctions(system, tree, chosen)
    record, nu = parts.functions["record"], tree.nu
    still = [ca.SX.zeros(k.numel()) for k in record.inputs[2:]]
    r, R, V = ca.substitute(list(record.outputs[:3]), list(record.inputs), [t, y, *still])
    rows = [whole.rows[k - whole.first] for k in sorted(whole.order.rows) if k >= whole.first]
    gaps = [e for row in rows for e in (row.phi, row.rate) if not e.is_zero()]
    H = ca.SX.zeros(nu, nu)
    for k in range(nu):
        for row, entry in whole.K[k].items():
            if row < nu:
                H[row, k] = entry
    return JointExpressions(
        t=t,
        y=y,
        rate=parts.accelerate().outputs[0],
        closed=parts.finish().outputs[0],
        r=r,
        R=R,
        V=V,
        T=ca.jacobian(whole.motion.q_dot(whole.motion.u), y[tree.nq :]),
        H=H,
        gaps=ca.vertcat(ca.SX(0, 1), *gaps),
        rows=len(chosen.rows),
    )


WRITER = ExpressionWriter(refuse_code, digest_equations, write_expressions)
