// Oimo: doubles. There is no gyroscopic torque, no option for it, and no damping; moments of inertia are those of shapes, and
// are set by hand here.
import oimo from "oimo";

const { BallAndSocketJoint, JointConfig, World } = oimo;

export function start(top, h) {
  const world = new World({ timestep: h, iterations: 8, broadphase: 1, worldscale: 1, random: false, gravity: top.gravity });
  const add = (pos, move) => world.add({ type: "sphere", size: [0.1], pos, move, density: 1, noSleep: true });
  const body = add(top.com, true);
  body.mass = top.mass;
  body.inverseMass = 1 / top.mass;
  const [a, b, c] = top.moments;
  body.localInertia.set(a, 0, 0, 0, b, 0, 0, 0, c);
  body.inverseLocalInertia.invert(body.localInertia);
  body.allowSleep = false;
  body.syncShapes();
  body.linearVelocity.set(...top.velocity);
  body.angularVelocity.set(...top.omega);
  if (!top.is_free) {
    const config = new JointConfig();
    Object.assign(config, { scale: 1, invScale: 1, body1: add([0, 0, 0], false), body2: body, allowCollision: false });
    config.localAnchorPoint1.set(0, 0, 0);
    config.localAnchorPoint2.set(...top.com.map((x) => -x));
    world.addJoint(new BallAndSocketJoint(config));
  }
  const { position: p, orientation: q, angularVelocity: w } = body;
  return { step: () => world.step(), read: () => [p.x, p.y, p.z, q.x, q.y, q.z, q.w, w.x, w.y, w.z] };
}
