// Jolt: singles. The gyroscopic torque is an option.
import load from "jolt-physics";

export async function start(top, h, best) {
  const J = await load();
  const settings = new J.JoltSettings(), pairs = new J.ObjectLayerPairFilterTable(1);
  const layers = new J.BroadPhaseLayerInterfaceTable(1, 1);
  layers.MapObjectToBroadPhaseLayer(0, new J.BroadPhaseLayer(0));
  settings.mObjectLayerPairFilter = pairs;
  settings.mBroadPhaseLayerInterface = layers;
  settings.mObjectVsBroadPhaseLayerFilter = new J.ObjectVsBroadPhaseLayerFilterTable(layers, 1, pairs, 1);
  const jolt = new J.JoltInterface(settings), physics = jolt.GetPhysicsSystem(), bodies = physics.GetBodyInterface();
  physics.SetGravity(new J.Vec3(...top.gravity));
  const place = new J.RVec3(...top.com), none = new J.Quat(0, 0, 0, 1);
  const made = new J.BodyCreationSettings(new J.SphereShape(0.1), place, none, J.EMotionType_Dynamic, 0);
  const tensor = J.Mat44.prototype.sIdentity();
  tensor.SetDiagonal3(new J.Vec3(...top.moments));
  made.mOverrideMassProperties = J.EOverrideMassProperties_MassAndInertiaProvided;
  made.mMassPropertiesOverride.mMass = top.mass;
  made.mMassPropertiesOverride.mInertia = tensor;
  made.mAllowSleeping = false;
  if (best) {
    made.mLinearDamping = made.mAngularDamping = 0; // default: 0.05
    made.mMaxAngularVelocity = 1e4; // default: 47 rad/s
    made.mApplyGyroscopicForce = true; // default: false
  }
  made.mLinearVelocity = new J.Vec3(...top.velocity);
  made.mAngularVelocity = new J.Vec3(...top.omega);
  const body = bodies.CreateBody(made);
  bodies.AddBody(body.GetID(), J.EActivation_Activate);
  if (!top.is_free) {
    const point = new J.PointConstraintSettings();
    point.mPoint1 = point.mPoint2 = new J.RVec3(0, 0, 0);
    physics.AddConstraint(point.Create(J.JoltInterface.prototype.sGetFixedToWorldBody(), body));
  }
  return {
    step: () => jolt.Step(h, 1),
    read: () => {
      const p = body.GetCenterOfMassPosition(), q = body.GetRotation(), w = body.GetAngularVelocity();
      return [p, q, w].flatMap((v) => [v.GetX(), v.GetY(), v.GetZ(), ...(v === q ? [v.GetW()] : [])]);
    },
  };
}
