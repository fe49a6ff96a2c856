"""A rigid body in PhysX, as SAPIEN has it. Its ball joint is a drive whose three displacements are locked."""

import numpy as np
import sapien
from sapien import physx


def run(body, integrator, h, steps, every):
    config = physx.get_scene_config()
    config.gravity = body.gravity
    physx.set_scene_config(config)
    system = physx.PhysxCpuSystem()
    system.timestep = h
    scene, entity, top = sapien.Scene([system]), sapien.Entity(), physx.PhysxRigidDynamicComponent()
    top.set_mass(body.mass)
    top.set_inertia(body.moments)
    top.set_cmass_local_pose(sapien.Pose(body.com))
    if integrator != "default":
        top.set_linear_damping(0)
        top.set_angular_damping(0)  # default: 0.05
        top.set_max_angular_velocity(1e4)
    top.set_sleep_threshold(0)
    entity.add_component(top)
    scene.add_entity(entity)
    top.set_linear_velocity(body.velocity)
    top.set_angular_velocity(body.omega)
    if not body.is_free:
        ground, joint = sapien.Entity(), physx.PhysxDriveComponent(top)
        joint.parent = physx.PhysxRigidStaticComponent()
        ground.add_component(joint.parent)
        scene.add_entity(ground)
        for lock in (joint.set_limit_x, joint.set_limit_y, joint.set_limit_z):
            lock(0, 0)
        entity.add_component(joint)
    for n in range(steps + 1):
        if n:
            system.step()
        if n % every == 0:
            pose = top.entity_pose
            yield *(pose * sapien.Pose(body.com)).p, *np.roll(pose.q, -1), *top.angular_velocity
