"""A rigid body in Bullet, as Panda3D has it. The numbers are singles."""

from panda3d import bullet, core


def run(body, integrator, h, steps, every):
    world, top = bullet.BulletWorld(), bullet.BulletRigidBodyNode("top")
    world.setGravity(core.Vec3(*body.gravity))
    top.addShape(bullet.BulletSphereShape(0.1))
    top.setMass(body.mass)
    top.setInertia(core.Vec3(*body.moments))
    top.setDeactivationEnabled(False)
    path = core.NodePath(top)
    path.setPos(*body.com)
    world.attachRigidBody(top)
    top.setLinearVelocity(core.Vec3(*body.velocity))
    top.setAngularVelocity(core.Vec3(*body.omega))
    if not body.is_free:
        world.attachConstraint(bullet.BulletSphericalConstraint(top, core.Point3(*(-x for x in body.com))))
    for n in range(steps + 1):
        if n:
            world.doPhysics(h, 0)
        if n % every == 0:
            q = path.getQuat()
            yield *path.getPos(), q.getI(), q.getJ(), q.getK(), q.getR(), *top.getAngularVelocity()
