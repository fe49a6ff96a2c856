"""A rigid body in Simbody, inside OpenSim, whose ball and free joints have three angles. It chooses its steps, of at most h."""

import opensim


def run(body, integrator, h, steps, every):
    opensim.Logger.setLevelString("error")
    model = opensim.Model()
    model.setGravity(opensim.Vec3(*body.gravity))
    com, moments = opensim.Vec3(*body.com), opensim.Inertia(*body.moments, 0, 0, 0)
    top = opensim.Body("top", body.mass, com, moments)
    kind = opensim.FreeJoint if body.is_free else opensim.BallJoint
    joint = kind("joint", model.getGround(), top)
    model.addBody(top)
    model.addJoint(joint)
    state = model.initSystem()
    for i in range(3):
        state.updU()[i] = body.omega[i]
    manager = opensim.Manager(model)
    if "accuracy" in integrator:
        manager.setIntegratorAccuracy(float(integrator.split()[-1]))
    manager.initialize(state)
    for n in range(steps + 1):
        if n:
            manager.integrate(n * h)
        if n % every == 0:
            now = manager.getState()
            model.realizeVelocity(now)
            q = top.getTransformInGround(now).R().convertRotationToQuaternion()
            place, omega = top.findStationLocationInGround(now, com), top.getAngularVelocityInGround(now)
            yield *place.to_numpy(), *(q.get(i) for i in (1, 2, 3, 0)), *omega.to_numpy()
