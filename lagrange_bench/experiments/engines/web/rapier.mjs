// Rapier: singles, with the gyroscopic torque.
import RAPIER from "@dimforge/rapier3d-compat";

export async function start(top, h, best) {
  await RAPIER.init();
  const vector = ([x, y, z]) => ({ x, y, z });
  const world = new RAPIER.World(vector(top.gravity));
  world.timestep = h;
  if (best) world.integrationParameters.numSolverIterations = 32; // default: 4
  const description = RAPIER.RigidBodyDesc.dynamic()
    .setAdditionalMassProperties(top.mass, vector(top.com), vector(top.moments), { x: 0, y: 0, z: 0, w: 1 })
    .setLinvel(...top.velocity)
    .setAngvel(vector(top.omega))
    .setCanSleep(false);
  const body = world.createRigidBody(description);
  body.recomputeMassPropertiesFromColliders(); // or worldCom() is the origin before the first step
  if (!top.is_free) {
    const ground = world.createRigidBody(RAPIER.RigidBodyDesc.fixed());
    const origin = vector([0, 0, 0]);
    world.createImpulseJoint(RAPIER.JointData.spherical(origin, origin), ground, body, true);
  }
  return {
    step: () => world.step(),
    read: () => {
      const p = body.worldCom(), q = body.rotation(), w = body.angvel();
      return [p.x, p.y, p.z, q.x, q.y, q.z, q.w, w.x, w.y, w.z];
    },
  };
}
