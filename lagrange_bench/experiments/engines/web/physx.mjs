// PhysX by physx-js-webidl: singles. The gyroscopic torque is an option, which the bindings do not name.
import { readFileSync } from "node:fs";

const GYROSCOPIC = 1 << 10; // PxRigidBodyFlag::eENABLE_GYROSCOPIC_FORCES

async function load() {
  // the package is built for browsers: node plays one while the module starts
  const folder = new URL("node_modules/physx-js-webidl/", import.meta.url), kept = globalThis.process;
  const wasmBinary = readFileSync(new URL("physx-js-webidl.wasm", folder));
  Object.assign(globalThis, { window: globalThis, document: { currentScript: null }, process: undefined });
  const { default: make } = await import(new URL("physx-js-webidl.mjs", folder));
  const made = await make({ wasmBinary });
  globalThis.process = kept;
  return made;
}

export async function start(top, h, best) {
  const P = await load(), T = P.PxTopLevelFunctions.prototype;
  const vector = (a) => new P.PxVec3(...a), none = new P.PxTransform(P.PxIDENTITYEnum.PxIdentity);
  const foundation = P.CreateFoundation(P.PHYSICS_VERSION, new P.PxDefaultAllocator(), new P.PxDefaultErrorCallback());
  const scale = new P.PxTolerancesScale(), physics = P.CreatePhysics(P.PHYSICS_VERSION, foundation, scale);
  P.InitExtensions(physics);
  const scene_desc = new P.PxSceneDesc(scale);
  scene_desc.gravity = vector(top.gravity);
  scene_desc.cpuDispatcher = T.DefaultCpuDispatcherCreate(0);
  scene_desc.filterShader = T.DefaultFilterShader();
  if (best) scene_desc.solverType = P.PxSolverTypeEnum.eTGS; // default: PGS
  const scene = physics.createScene(scene_desc), body = physics.createRigidDynamic(none);
  const centre = new P.PxTransform(P.PxIDENTITYEnum.PxIdentity);
  centre.p = vector(top.com);
  body.setMass(top.mass);
  body.setMassSpaceInertiaTensor(vector(top.moments));
  body.setCMassLocalPose(centre);
  if (best) {
    body.setLinearDamping(0);
    body.setAngularDamping(0); // default: 0.05
    body.setMaxAngularVelocity(1e4); // default: 100 rad/s
    body.setRigidBodyFlag(GYROSCOPIC, true);
    body.setSolverIterationCounts(64, 16); // default: 4, 1
  }
  body.setLinearVelocity(vector(top.velocity));
  body.setAngularVelocity(vector(top.omega));
  body.setSleepThreshold(0);
  scene.addActor(body);
  if (!top.is_free) T.SphericalJointCreate(physics, undefined, none, body, none);
  return {
    step: () => {
      scene.simulate(h);
      scene.fetchResults(true);
    },
    read: () => {
      const pose = body.getGlobalPose(), p = pose.transform(vector(top.com)), q = pose.q, w = body.getAngularVelocity();
      return [p.x, p.y, p.z, q.x, q.y, q.z, q.w, w.x, w.y, w.z];
    },
  };
}
