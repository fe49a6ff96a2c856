"""A rigid body in Newton, on a processor."""

import newton
import numpy as np
import warp
from scipy.spatial.transform import Rotation

OPTIONS = {
    "XPBD, equal relaxation": {
        "joint_angular_relaxation": 0.7
    },  # as the linear one; else a joint has 4/7 of its torque
    "MuJoCo, RK4": {"integrator": "rk4"},
}


def run(body, integrator, h, steps, every):
    warp.config.quiet = True
    build = newton.ModelBuilder(gravity=warp.vec3(*body.gravity))
    inertia = warp.mat33(*np.diag(body.moments).ravel().tolist())
    link = build.add_link(mass=body.mass, com=warp.vec3(*body.com), inertia=inertia)
    build.add_articulation([build.add_joint_free(link) if body.is_free else build.add_joint_ball(-1, link)])
    model = build.finalize()
    solver = getattr(newton.solvers, f"Solver{integrator.partition(', ')[0]}")(model, **OPTIONS.get(integrator, {}))
    now, after, control = model.state(), model.state(), model.control()
    now.joint_qd.assign(np.append(body.velocity, body.omega)[-model.joint_dof_count :])
    newton.eval_fk(model, now.joint_q, now.joint_qd, now)
    for n in range(steps + 1):
        if n:
            now.clear_forces()
            solver.step(now, after, control, None, h)
            now, after = after, now
        if n % every == 0:
            place, twist = now.body_q.numpy()[0], now.body_qd.numpy()[0]
            yield *(place[:3] + Rotation.from_quat(place[3:]).apply(body.com)), *place[3:], *twist[3:]
