// cannon-es: doubles. There is no gyroscopic torque, and no option for it.
import { Body, PointToPointConstraint, Vec3, World } from "cannon-es";

export function start(top, h, best) {
  const vector = (a) => new Vec3(...a);
  const world = new World({ gravity: vector(top.gravity) });
  const body = new Body({
    mass: top.mass,
    position: vector(top.com),
    velocity: vector(top.velocity),
    angularVelocity: vector(top.omega),
  });
  body.inertia.set(...top.moments); // without a shape there is no other way, and it stays
  body.invInertia.set(...top.moments.map((moment) => 1 / moment));
  body.updateInertiaWorld(true);
  world.addBody(body);
  if (best) body.linearDamping = body.angularDamping = 0; // default: 0.01
  if (!top.is_free) {
    const ground = new Body({ mass: 0 });
    world.addBody(ground);
    const pivot = top.com.map((x) => -x);
    const joint = new PointToPointConstraint(ground, vector([0, 0, 0]), body, vector(pivot));
    world.addConstraint(joint);
    if (best) {
      world.solver.iterations = 100; // default: 10
      world.solver.tolerance = 1e-12;
      for (const equation of joint.equations) equation.setSpookParams(1e10, 3, h); // default: for 1/60 s
    }
  }
  const { position: p, quaternion: q, angularVelocity: w } = body;
  return { step: () => world.step(h), read: () => [p.x, p.y, p.z, q.x, q.y, q.z, q.w, w.x, w.y, w.z] };
}
