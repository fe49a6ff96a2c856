"""A rigid body in Drake. The joint of a top has three angles: the spin is the roll, and along z it is singular."""

import numpy as np
from pydrake import all as drake


def turned(body):
    """The frames of the joint: x along the axis, z along the direction that the exact path stays farthest from."""
    across = [(np.cos(angle), 0.0, np.sin(angle)) for angle in np.linspace(0.0, np.pi, 37)]
    path = body.case.solution(np.linspace(0.0, body.case.until, 2001)).position
    z = min(across, key=lambda z: np.max(np.abs(path @ z)))
    return drake.RigidTransform(drake.RotationMatrix(np.column_stack((body.com, np.cross(z, body.com), z))))


def run(body, integrator, h, steps, every):
    plant = drake.MultibodyPlant(h if integrator == "discrete" else 0.0)
    inertia = drake.SpatialInertia.MakeFromCentralInertia(body.mass, body.com, drake.RotationalInertia(*body.moments))
    top = plant.AddRigidBody("top", inertia)
    if not body.is_free:
        ends, pose = (("joint", plant.world_frame()), ("body", top.body_frame())), turned(body)
        frames = [plant.AddFrame(drake.FixedOffsetFrame(*end, pose)) for end in ends]
        joint = plant.AddJoint(drake.BallRpyJoint("ball", *frames))
    plant.mutable_gravity_field().set_gravity_vector(body.gravity)
    plant.Finalize()
    simulator = drake.Simulator(plant)
    context = simulator.get_mutable_context()
    if body.is_free:
        plant.SetFreeBodySpatialVelocity(context, top, drake.SpatialVelocity(body.omega, body.velocity))
    else:
        joint.set_angular_velocity(context, pose.rotation().matrix().T @ body.omega)
    if integrator != "discrete":
        scheme, _, control = integrator.partition(", ")
        config = drake.SimulatorConfig(integration_scheme=scheme, max_step_size=h, use_error_control=bool(control))
        drake.ApplySimulatorConfig(config, simulator)
    simulator.Initialize()
    for n in range(steps // every + 1):
        if n:
            simulator.AdvanceTo(n * every * h)
        pose, twist = plant.EvalBodyPoseInWorld(context, top), plant.EvalBodySpatialVelocityInWorld(context, top)
        yield *pose.multiply(body.com), *pose.rotation().matrix().ravel(), *twist.rotational()
