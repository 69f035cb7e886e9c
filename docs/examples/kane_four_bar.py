"""Measure the drift of a four-bar linkage in Kane's equations: SymPy's KanesMethod, dependent coordinates, SciPy.

Links of 0.5, 1.2 and 0.9 m on a base of 1 m, 2 kg each. The same object is a problem of mbsbench (``read_sympy``).
"""

import numpy as np
import sympy as sp
import sympy.physics.mechanics as me
from scipy.integrate import solve_ivp

from mbsbench import read_sympy

T_END, RTOL = 10.0, 1e-6
q, u = me.dynamicsymbols("q1:4"), me.dynamicsymbols("u1:4")
m, g, *l = sp.symbols("m g l1:5")
N, O = me.ReferenceFrame("N"), me.Point("O")
O.set_vel(N, 0)
end, frame, speed, bodies, loads = O, N, 0, [], []
for i in range(3):
    frame, speed = frame.orientnew(f"F{i}", "Axis", (q[i], N.z)), speed + u[i]
    frame.set_ang_vel(N, speed * N.z)
    C, tip = end.locatenew(f"C{i}", l[i] / 2 * frame.x), end.locatenew(f"P{i}", l[i] * frame.x)
    for p in (C, tip):
        p.v2pt_theory(end, N, frame)
    bodies.append(me.RigidBody(f"link{i + 1}", C, frame, m, (me.inertia(frame, 0.01, 0.1, 0.1), C)))
    loads.append((C, -m * g * N.y))
    end = tip
gap = [(end.pos_from(O) - l[3] * N.x).dot(e) for e in (N.x, N.y)]
rates = dict(zip([c.diff() for c in q], u, strict=True))
kane = me.KanesMethod(
    N,
    q[:1],
    u[:1],
    [c.diff() - w for c, w in zip(q, u, strict=True)],
    q_dependent=q[1:],
    u_dependent=u[1:],
    configuration_constraints=gap,
    velocity_constraints=[me.msubs(f.diff(me.dynamicsymbols._t), rates) for f in gap],
)
kane.kanes_equations(bodies, loads)
values = {m: 2.0, g: 9.81, **dict(zip(l, (0.5, 1.2, 0.9, 1.0), strict=True))}
problem = read_sympy(kane, values, {q[0]: 1.2, q[1]: -1.0, q[2]: -1.7}, t_end=T_END)

links = [np.arctan2(R[1, 0], R[0, 0]) for R in problem.initial.R]  # the closed start: angles of the links
y = np.concatenate((np.diff(links, prepend=0.0), np.zeros(3)))
M, f, phi = (
    sp.lambdify([(*kane.q, *kane.u)], me.msubs(sp.Matrix(e), values), cse=True)
    for e in (kane.mass_matrix_full, kane.forcing_full, gap)
)
by_kane = solve_ivp(lambda t, y: np.linalg.solve(M(y), f(y)).ravel(), (0.0, T_END), y, rtol=RTOL, atol=RTOL)
print(f"gap after {T_END:g} s: {np.linalg.norm(phi(by_kane.y[:, -1])):.3g} m")  # noqa: T201
