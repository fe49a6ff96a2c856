// Havok for the web: singles. There is no gyroscopic torque, and no option for it. Moments of inertia are those of 1 kg.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import load from "@babylonjs/havok";

export async function start(top, h, best) {
  const main = createRequire(import.meta.url).resolve("@babylonjs/havok");
  const H = await load({ wasmBinary: readFileSync(new URL("../esm/HavokPhysics.wasm", `file://${main}`)) });
  const [, world] = H.HP_World_Create();
  H.HP_World_SetGravity(world, top.gravity);
  H.HP_World_SetIdealStepTime(world, h);
  const add = (motion) => {
    const [, body] = H.HP_Body_Create(), [, shape] = H.HP_Shape_CreateSphere([0, 0, 0], 0.01);
    H.HP_Body_SetShape(body, shape);
    H.HP_Body_SetMotionType(body, motion);
    H.HP_Body_SetPosition(body, [0, 0, 0]);
    return body;
  };
  const body = add(H.MotionType.DYNAMIC);
  H.HP_Body_SetMassProperties(body, [top.com, top.mass, top.moments.map((i) => i / top.mass), [0, 0, 0, 1]]);
  if (best) {
    H.HP_World_SetSpeedLimit(world, 1e4, 1e4); // default: 200 m/s, 100 rad/s
    H.HP_Body_SetLinearDamping(body, 0);
    H.HP_Body_SetAngularDamping(body, 0); // default: 0.1
  }
  H.HP_Body_SetActivationControl(body, H.ActivationControl.ALWAYS_ACTIVE);
  H.HP_World_AddBody(world, body, false);
  H.HP_Body_SetLinearVelocity(body, top.velocity);
  H.HP_Body_SetAngularVelocity(body, top.omega);
  if (!top.is_free) {
    const ground = add(H.MotionType.STATIC), [, joint] = H.HP_Constraint_Create();
    H.HP_World_AddBody(world, ground, false);
    H.HP_Constraint_SetParentBody(joint, ground);
    H.HP_Constraint_SetChildBody(joint, body);
    H.HP_Constraint_SetAnchorInParent(joint, [0, 0, 0], [1, 0, 0], [0, 1, 0]);
    H.HP_Constraint_SetAnchorInChild(joint, [0, 0, 0], [1, 0, 0], [0, 1, 0]);
    for (const axis of [H.ConstraintAxis.LINEAR_X, H.ConstraintAxis.LINEAR_Y, H.ConstraintAxis.LINEAR_Z])
      H.HP_Constraint_SetAxisMode(joint, axis, H.ConstraintAxisLimitMode.LOCKED);
    H.HP_Constraint_SetCollisionsEnabled(joint, 0);
    H.HP_Constraint_SetEnabled(joint, 1);
  }
  return {
    step: () => H.HP_World_Step(world, h),
    read: () => {
      const [p, q] = H.HP_Body_GetQTransform(body)[1];
      return [...p.map((x, i) => x + turned(q, top.com)[i]), ...q, ...H.HP_Body_GetAngularVelocity(body)[1]];
    },
  };
}

// a vector turned by a unit quaternion: a + s t + q × t with t = 2 q × a
function turned([x, y, z, s], a) {
  const cross = (u, v) => [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
  const t = cross([x, y, z], a).map((value) => 2 * value), more = cross([x, y, z], t);
  return a.map((value, i) => value + s * t[i] + more[i]);
}
