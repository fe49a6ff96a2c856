"""A rigid body in Pinocchio, which has the dynamics (`aba`) and the exponential map (`integrate`), but no integrator: the steps
are written here. A free body turns in a ball joint at its centre of mass, which feels no force."""

import numpy as np
import pinocchio as pin


def run(body, integrator, h, steps, every):
    model, com = pin.Model(), np.array(body.com)
    joint = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "joint")
    model.appendBodyToJoint(joint, pin.Inertia(body.mass, com, np.diag(body.moments)), pin.SE3.Identity())
    model.gravity.linear = np.array(body.gravity)
    data, torque = model.createData(), np.zeros(3)
    q, v = pin.neutral(model), np.array(body.omega)

    def slope(u, v):
        """u' = v + u × v/2 + u × (u × v)/12, the first terms of dexp⁻¹; and v'."""
        turn = pin.skew(u)
        w = turn @ v
        return np.array((v + w / 2.0 + turn @ w / 12.0, pin.aba(model, data, pin.integrate(model, q, u), v, torque)))

    def row():
        pin.forwardKinematics(model, data, q)
        pose = data.oMi[joint]
        return *pose.act(com), *pose.rotation.ravel(), *(pose.rotation @ v)

    yield row()
    for n in range(1, steps + 1):
        if integrator == "RKMK4":
            y = np.array((np.zeros(3), v))
            a = slope(*y)
            b = slope(*(y + h / 2.0 * a))
            c = slope(*(y + h / 2.0 * b))
            u, v = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + slope(*(y + h * c)))
        else:  # semi-implicit Euler
            v = v + h * pin.aba(model, data, q, v, torque)
            u = h * v
        q = pin.integrate(model, q, u)
        if n % every == 0:
            yield row()
