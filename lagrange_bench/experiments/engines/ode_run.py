"""A rigid body in ODE, as Panda3D has it. The numbers are singles."""

from panda3d import ode


def run(body, integrator, h, steps, every):
    world, mass = ode.OdeWorld(), ode.OdeMass()
    world.setGravity(*body.gravity)
    if integrator != "default":
        world.setErp(0.8)
        world.setCfm(0.0)
    top = ode.OdeBody(world)
    mass.setParameters(body.mass, 0, 0, 0, *body.moments, 0, 0, 0)
    top.setMass(mass)
    top.setPosition(*body.com)
    top.setLinearVel(*body.velocity)
    top.setAngularVel(*body.omega)
    top.setAutoDisableFlag(False)
    if not body.is_free:
        joint = ode.OdeBallJoint(world)
        joint.attach(top, None)
        joint.setAnchor(0, 0, 0)
    for n in range(steps + 1):
        if n:
            world.step(h)
        if n % every == 0:
            q = top.getQuaternion()
            yield *top.getPosition(), q[1], q[2], q[3], q[0], *top.getAngularVel()
