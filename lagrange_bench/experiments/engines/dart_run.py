"""A rigid body in DART."""

import dartpy
import numpy as np


def run(body, integrator, h, steps, every):
    world, skeleton = dartpy.simulation.World(), dartpy.dynamics.Skeleton()
    world.setGravity(body.gravity)
    world.setTimeStep(h)
    make = skeleton.createFreeJointAndBodyNodePair if body.is_free else skeleton.createBallJointAndBodyNodePair
    _, top = make()
    top.setInertia(dartpy.dynamics.Inertia(body.mass, np.array(body.com), np.diag(body.moments)))
    world.addSkeleton(skeleton)
    skeleton.setVelocities(np.append(body.omega, np.zeros(3 * body.is_free)))
    for n in range(steps + 1):
        if n:
            world.step()
        if n % every == 0:
            yield *top.getCOM(), *top.getTransform().rotation().ravel(), *top.getAngularVelocity()
