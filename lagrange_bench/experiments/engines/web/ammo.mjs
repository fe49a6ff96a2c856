// ammo.js is Bullet: singles, with the gyroscopic torque, by default in an implicit form.
import load from "ammojs3/dist/ammo.js";

export async function start(top, h, best) {
  const A = await load();
  const vector = (a) => new A.btVector3(...a);
  const config = new A.btDefaultCollisionConfiguration(), solver = new A.btSequentialImpulseConstraintSolver();
  const world = new A.btDiscreteDynamicsWorld(new A.btCollisionDispatcher(config), new A.btDbvtBroadphase(), solver, config);
  world.setGravity(vector(top.gravity));
  const place = new A.btTransform();
  place.setIdentity();
  place.setOrigin(vector(top.com));
  const state = new A.btDefaultMotionState(place), shape = new A.btSphereShape(0.1);
  const body = new A.btRigidBody(new A.btRigidBodyConstructionInfo(top.mass, state, shape, vector(top.moments)));
  body.setLinearVelocity(vector(top.velocity));
  body.setAngularVelocity(vector(top.omega));
  body.setActivationState(4); // never sleep
  if (best) body.setFlags(2); // BT_ENABLE_GYROSCOPIC_FORCE_EXPLICIT
  world.addRigidBody(body);
  if (!top.is_free) world.addConstraint(new A.btPoint2PointConstraint(body, vector(top.com.map((x) => -x))), true);
  return {
    step: () => world.stepSimulation(h, 0),
    read: () => {
      const pose = body.getWorldTransform(), p = pose.getOrigin(), q = pose.getRotation(), w = body.getAngularVelocity();
      return [p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w(), w.x(), w.y(), w.z()];
    },
  };
}
