"""A rigid body in Rapier. The numbers are singles."""

import rapier3d


def run(body, integrator, h, steps, every):
    world = rapier3d.PhysicsWorld(gravity=tuple(body.gravity))
    world.integration_parameters.dt = h
    is_default = integrator == "default"
    if not is_default:
        world.integration_parameters.num_solver_iterations = 32  # default: 4
    mass = rapier3d.MassProperties(tuple(body.com), body.mass, tuple(body.moments), (0, 0, 0, 1))
    description = rapier3d.RigidBody.dynamic().additional_mass_properties(mass).can_sleep(False)
    description = description.allow_fast_rotation(not is_default)  # without it, at most 45° a substep
    handle = world.add_body(description.linvel(tuple(body.velocity)).angvel(tuple(body.omega)))
    world.rigid_bodies[handle].recompute_mass_properties_from_colliders(world.colliders)
    if not body.is_free:
        ground = world.add_body(rapier3d.RigidBody.fixed())
        world.impulse_joints.insert(ground, handle, rapier3d.SphericalJointBuilder())
    for n in range(steps + 1):
        if n:
            world.step()
        if n % every == 0:
            top = world.rigid_bodies[handle]
            p, q, w = top.center_of_mass, top.rotation, top.angvel
            yield p.x, p.y, p.z, q.i, q.j, q.k, q.w, w.x, w.y, w.z
