"""Adapters: each makes one program follow a rigid body, by the program's own public interface.

An adapter takes the module of the program, the body, the name of an integrator or of settings, and the step h in s. It returns a
`Run`. The rows of a run have the centre of mass in the world, the rotation from body to world, and the angular velocity in the
world. Rotations are matrices or quaternions, scalar last. All numbers are the program's own, so their precision can be seen.

Bodies are free, or turn about a fixed point. Programs with reduced coordinates have a ball joint there, others a constraint. With
`rail` the body is a mass that slides on a rail instead: its run shows the time that has little to do with the top.
"""

import importlib
import json
import subprocess
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import integrate, prepare
from lagrange_bench.integrators.cases import Case
from lagrange_bench.integrators.interface import Array, StepError

State = tuple[Any, Any, Any]  # centre of mass, rotation, angular velocity
Run = Callable[[int, int], Iterable[State]]  # (number of steps, steps between two rows) → rows
WEB = Path(__file__).parent / "web"


class Body(NamedTuple):
    """The body of a case and its start, with the rotation 0, as lists of numbers in SI units.

    free : no weight, and no fixed point. moments : about the centre of mass, com. velocity : of the centre of mass.
    """

    case: Case
    free: bool
    mass: float
    moments: list[float]
    com: list[float]
    gravity: list[float]
    omega: list[float]
    velocity: list[float]

    @classmethod
    def of(cls, case: Case) -> "Body":
        body, omega = case.body, np.asarray(case.omega_body, dtype=float)
        com, gravity = np.asarray(body.com, dtype=float), np.asarray(body.gravity, dtype=float)
        numbers = (np.diag(body.inertia_com), com, gravity, omega, np.cross(omega, com))
        return cls(case, not (com.any() or gravity.any()), float(body.mass), *(each.tolist() for each in numbers))


def words(values: Any) -> str:
    return " ".join(map(repr, np.asarray(values, dtype=float).tolist()))


def stepping(advance: Callable[[int], Any], read: Callable[[], State]) -> Run:
    """The run of a program: `advance` takes n steps in one call, and `read` returns the row there."""

    def run(steps: int, every: int) -> Iterable[State]:
        for _ in range(steps // every):
            advance(every)
            yield read()

    return run


def loop(step: Callable[[], Any]) -> Callable[[int], None]:
    """A function of n that calls `step` n times, in Python."""

    def advance(n: int) -> None:
        for _ in range(n):
            step()

    return advance


def bench(_: Any, top: Body, kind: str, h: float, rail: bool = False) -> Run:
    body, y0 = top.case.body, top.case.state
    if kind == "backlund":  # the exact step; the attitude comes with the rows

        def exact(steps: int, every: int) -> Iterable[State]:
            run = integrate(body, y0, h=h, steps=steps, method=kind, every=every)
            return list(zip(run.position[1:], run.rotation.as_matrix()[1:], run.omega_world[1:], strict=True))

        return exact
    stepper = prepare(body, y0, h, kind)

    def run(steps: int, every: int) -> Iterable[State]:
        for n in range(every, steps + 1, every):
            y = stepper.advance(y0, n)[None]
            turn = body.rotations(y)[0]
            yield turn.apply(body.com), turn.as_matrix(), turn.apply(body.angular_velocity(y)[0])

    return run


def mjcf(top: Body, kind: str, h: float, rail: bool = False) -> str:
    """The model as a file of MuJoCo, which other programs read, too."""
    joint = "slide" if rail else "free" if top.free else "ball"
    return f"""
        <mujoco><option timestep="{h!r}" integrator="{kind}" gravity="{words(top.gravity)}"/>
        <worldbody><body><joint type="{joint}"/>
        <inertial pos="{words(top.com)}" mass="{top.mass!r}" diaginertia="{words(top.moments)}"/>
        </body></worldbody></mujoco>"""


def at_start(mj: Any, top: Body, kind: str, h: float, rail: bool = False) -> tuple[Any, Any]:
    """A model of MuJoCo, and its data at the start."""
    model = mj.MjModel.from_xml_string(mjcf(top, kind, h, rail))
    data = mj.MjData(model)
    if not rail:
        data.qvel[-3:] = top.omega
    return model, data


def mujoco(mj: Any, top: Body, kind: str, h: float, rail: bool = False) -> Run:
    model, data = at_start(mj, top, kind, h, rail)
    mj.set_mju_user_warning(lambda text: None)  # a warning would write a file; its counter is read below

    def read() -> State:
        if any(warning.number for warning in data.warning):
            raise StepError(f"mujoco {kind}", "the engine met huge numbers, warned, and began anew")
        mj.mj_forward(model, data)
        return data.xipos[1].copy(), data.xmat[1].reshape(3, 3).copy(), data.cvel[1][:3].copy()

    return stepping(lambda n: mj.mj_step(model, data, n), read)


def placed(mj: Any, model: Any, data: Any, q: Any, v: Any) -> State:
    """The row at coordinates q and speeds v of the joint, by the model of MuJoCo."""
    data.qpos[:], data.qvel[:] = q, v
    mj.mj_forward(model, data)
    return data.xipos[1].copy(), np.roll(q[-4:], -1), data.cvel[1][:3].copy()


def mujoco_warp(warp: Any, top: Body, kind: str, h: float) -> Run:
    mj = importlib.import_module("mujoco")
    importlib.import_module("warp").config.quiet = True
    model, data = at_start(mj, top, kind, h)
    mj.mj_forward(model, data)
    device_model, state = warp.put_model(model), warp.put_data(model, data)
    step = loop(lambda: warp.step(device_model, state))
    return stepping(step, lambda: placed(mj, model, data, state.qpos.numpy()[0], state.qvel.numpy()[0]))


DOUBLES = ", doubles"


def mjx(mjx: Any, top: Body, kind: str, h: float) -> Run:
    mj, jax = importlib.import_module("mujoco"), importlib.import_module("jax")
    jax.config.update("jax_enable_x64", kind.endswith(DOUBLES))
    jax.clear_caches()  # they hold code of the other precision
    model, data = at_start(mj, top, kind.removesuffix(DOUBLES), h)
    device_model, state, once = mjx.put_model(model), [mjx.put_data(model, data)], jax.jit(mjx.step)

    def step() -> None:
        state[0] = once(device_model, state[0])

    return stepping(loop(step), lambda: placed(mj, model, data, np.asarray(state[0].qpos), np.asarray(state[0].qvel)))


DISCRETE, CONTROLLED = "discrete", ", error control"
EXPLICIT = ("RK44", f"DOPRI5{CONTROLLED}", "RK67")  # the second chooses its steps, of at most h


def exudyn(exu: Any, top: Body, kind: str, h: float, rail: bool = False) -> Run:
    """A ball joint is a constraint, which only `generalized-alpha` has here. The other integrators have a free body with the
    moments about the fixed point and the torque of the weight: it turns as the top does."""
    importlib.import_module("exudyn.utilities")
    tools, mbs = exu.utilities, exu.SystemContainer().AddSystem()
    com, weight = np.array(top.com), top.mass * np.array(top.gravity)
    inertia, joint = np.diag(top.moments), kind == "generalized-alpha"
    if not joint:
        inertia = inertia + top.mass * (com @ com * np.eye(3) - np.outer(com, com))
    facts = {
        "inertia": tools.RigidBodyInertia(mass=top.mass, inertiaTensor=inertia),
        "initialAngularVelocity": top.omega,
    }
    if rail:
        body = mbs.CreateMassPoint(physicsMass=top.mass, initialVelocity=[1, 0, 0])
    elif joint:
        start = {"referencePosition": com, "initialVelocity": top.velocity, "gravity": top.gravity}
        body = mbs.CreateRigidBody(**start, **facts)
        if not top.free:
            mbs.CreateSphericalJoint(itemNumbers=[mbs.CreateGround(), body], position=[0, 0, 0])
    else:
        body = mbs.CreateRigidBody(nodeType=exu.NodeType.RotationRotationVector, **facts)
        for place, force in ((com, weight), ([0, 0, 0], -weight)):
            marker = mbs.AddMarker(tools.MarkerBodyRigid(bodyNumber=body, localPosition=place))
            mbs.AddLoad(tools.LoadForceVector(markerNumber=marker, loadVector=force))
    output = exu.OutputVariableType
    wanted = () if rail else (output.Position, output.RotationMatrix, output.AngularVelocity)
    sensors = [
        mbs.AddSensor(tools.SensorBody(bodyNumber=body, storeInternal=True, outputVariableType=each)) for each in wanted
    ]
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = settings.timeIntegration.automaticStepSize = False
    settings.timeIntegration.generalizedAlpha.lieGroupAddTangentOperator = joint  # not with rotation vectors
    name = kind.removesuffix(CONTROLLED) if kind in EXPLICIT else "GeneralizedAlpha"
    solver = getattr(exu.DynamicSolverType, name)

    def run(steps: int, every: int) -> Iterable[State]:
        settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = steps, steps * h
        settings.solution.sensors.writePeriod = every * h
        mbs.SolveDynamic(settings, solverType=solver, showHints=False)
        if rail:
            return []
        place, matrix, omega = (mbs.GetSensorStoredData(each)[1:, 1:] for each in sensors)
        matrix = matrix.reshape(-1, 3, 3)
        return list(zip(place if joint else matrix @ com, matrix, omega, strict=True))

    return run


def drake(pydrake: Any, top: Body, kind: str, h: float, rail: bool = False) -> Run:
    """A free body has a quaternion, a top a joint with three angles. The joint's frames are turned: the spin is the roll, and the
    joint is singular along z, so z points where the axis comes least near."""
    every = importlib.import_module("pydrake.all")
    plant, com = every.MultibodyPlant(h if kind == DISCRETE else 0.0), np.array(top.com)
    inertia = every.SpatialInertia.MakeFromCentralInertia(top.mass, com, every.RotationalInertia(*top.moments))
    body = plant.AddRigidBody("top", inertia)
    if not top.free:
        angles = np.linspace(0.0, np.pi, 37)
        across = np.stack((np.cos(angles), np.zeros(37), np.sin(angles)))
        path = top.case.solution(np.linspace(0.0, top.case.until, 2001)).position
        z = across[:, np.argmin(np.max(np.abs(path @ across), axis=0))]
        turned = every.RigidTransform(every.RotationMatrix(np.column_stack((com, np.cross(z, com), z))))
        ends = ("joint", plant.world_frame()), ("body", body.body_frame())
        frames = [plant.AddFrame(every.FixedOffsetFrame(*end, turned)) for end in ends]
        slide = every.PrismaticJoint("slide", *frames, [1, 0, 0]) if rail else every.BallRpyJoint("ball", *frames)
        joint = plant.AddJoint(slide)
    plant.mutable_gravity_field().set_gravity_vector(top.gravity)
    plant.Finalize()
    simulator = every.Simulator(plant)
    context = simulator.get_mutable_context()
    if top.free:
        plant.SetFreeBodySpatialVelocity(body, every.SpatialVelocity(top.omega, top.velocity), context)
    elif not rail:
        joint.set_angular_velocity(context, turned.rotation().matrix().T @ top.omega)
    if kind != DISCRETE:
        scheme, controlled = kind.removesuffix(CONTROLLED), kind.endswith(CONTROLLED)
        choice = every.SimulatorConfig(integration_scheme=scheme, max_step_size=h, use_error_control=controlled)
        every.ApplySimulatorConfig(choice, simulator)
    simulator.Initialize()

    def read() -> State:
        pose = plant.EvalBodyPoseInWorld(context, body)
        omega = plant.EvalBodySpatialVelocityInWorld(context, body).rotational()
        return pose.multiply(com), pose.rotation().matrix(), omega

    return stepping(lambda n: simulator.AdvanceTo(context.get_time() + n * h), read)


def pinocchio(pin: Any, top: Body, kind: str, h: float, rail: bool = False) -> Run:
    """Pinocchio has the dynamics (`aba`) and the exponential map (`integrate`), but no integrator: the steps are written here.
    A free body turns in a ball joint at its centre of mass, which feels no force."""
    model, com = pin.Model(), np.array(top.com)
    number = model.addJoint(0, pin.JointModelPX() if rail else pin.JointModelSpherical(), pin.SE3.Identity(), "joint")
    model.appendBodyToJoint(number, pin.Inertia(top.mass, com, np.diag(top.moments)), pin.SE3.Identity())
    model.gravity.linear = np.array(top.gravity)
    data, torque = model.createData(), np.zeros(model.nv)
    state = [pin.neutral(model), np.ones(1) if rail else np.array(top.omega)]

    def euler(q: Array, v: Array) -> list[Any]:
        v = v + h * pin.aba(model, data, q, v, torque)
        return [pin.integrate(model, q, h * v), v]

    def rkmk4(q: Array, v: Array) -> list[Any]:
        def slope(u: Array, v: Array) -> Array:  # u' = v + u × v/2 + u × (u × v)/12, the first terms of dexp⁻¹; and v'
            rate = v
            if not rail:
                turn = pin.skew(u)
                w = turn @ v
                rate = v + w / 2.0 + turn @ w / 12.0
            return np.array((rate, pin.aba(model, data, pin.integrate(model, q, u), v, torque)))

        y = np.array((np.zeros_like(v), v))
        a = slope(*y)
        b = slope(*(y + h / 2.0 * a))
        c = slope(*(y + h / 2.0 * b))
        u, v = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + slope(*(y + h * c)))
        return [pin.integrate(model, q, u), v]

    step = rkmk4 if kind == "RKMK4" else euler

    def once() -> None:
        state[:] = step(*state)

    def read() -> State:
        pin.forwardKinematics(model, data, state[0])
        pose = data.oMi[number]
        return pose.act(com), pose.rotation.copy(), pose.rotation @ np.resize(state[1], 3)

    return stepping(loop(once), read)


def pybullet(pb: Any, top: Body, kind: str, h: float, rail: bool = False) -> Run:
    if pb.isConnected():
        pb.disconnect()
    pb.connect(pb.DIRECT)
    pb.setGravity(*top.gravity)
    pb.setTimeStep(h)
    nothing = {"linkCollisionShapeIndices": [-1], "linkVisualShapeIndices": [-1], "linkPositions": [[0, 0, 0]]}
    frames = {"linkInertialFramePositions": [top.com], "linkJointAxis": [[1, 0, 0]], "linkParentIndices": [0]}
    turns = {"linkOrientations": [[0, 0, 0, 1]], "linkInertialFrameOrientations": [[0, 0, 0, 1]]}
    joint = {"linkJointTypes": [pb.JOINT_PRISMATIC if rail else pb.JOINT_SPHERICAL], "linkMasses": [top.mass]}
    link = -1 if top.free else 0
    body = (
        pb.createMultiBody(top.mass)
        if top.free
        else pb.createMultiBody(0, -1, -1, **nothing, **frames, **turns, **joint)
    )
    pb.changeDynamics(body, link, localInertiaDiagonal=top.moments)
    if kind == "Euler, undamped":
        pb.changeDynamics(body, link, linearDamping=0, angularDamping=0, jointDamping=0, maxJointVelocity=1e9)
    if top.free:
        pb.resetBaseVelocity(body, angularVelocity=top.omega)
    elif not rail:  # a motor holds every joint until it is switched off
        still = {"targetPosition": [0, 0, 0, 1], "positionGain": 0, "velocityGain": 0, "force": [0, 0, 0]}
        pb.setJointMotorControlMultiDof(body, 0, pb.POSITION_CONTROL, **still)
        pb.resetJointStateMultiDof(body, 0, [0, 0, 0, 1], top.omega)

    def read() -> State:
        if top.free:
            return *pb.getBasePositionAndOrientation(body), pb.getBaseVelocity(body)[1]
        link = pb.getLinkState(body, 0, computeForwardKinematics=1, computeLinkVelocity=1)
        return link[0], link[5], link[7]

    return stepping(loop(pb.stepSimulation), read)


def dart(dartpy: Any, top: Body, kind: str, h: float, rail: bool = False) -> Run:
    world, skeleton = dartpy.simulation.World(), dartpy.dynamics.Skeleton()
    world.setGravity(top.gravity)
    world.setTimeStep(h)
    joint = "Prismatic" if rail else "Free" if top.free else "Ball"
    body = getattr(skeleton, f"create{joint}JointAndBodyNodePair")()[1]
    body.setInertia(dartpy.dynamics.Inertia(top.mass, np.array(top.com), np.diag(top.moments)))
    world.addSkeleton(skeleton)
    if not rail:
        skeleton.setVelocities(np.array(top.omega + [0.0] * 3 * top.free))

    def read() -> State:
        return body.getCOM(), body.getTransform().rotation(), body.getAngularVelocity()

    return stepping(loop(world.step), read)


def simbody(osim: Any, top: Body, kind: str, h: float) -> Run:
    """Simbody inside OpenSim, whose ball and free joints have three angles. It chooses its steps, of at most h."""
    osim.Logger.setLevelString("error")
    model = osim.Model()
    model.setGravity(osim.Vec3(*top.gravity))
    body = osim.Body("top", top.mass, osim.Vec3(*top.com), osim.Inertia(*top.moments, 0, 0, 0))
    joint = (osim.FreeJoint if top.free else osim.BallJoint)("joint", model.getGround(), body)
    model.addBody(body)
    model.addJoint(joint)
    state = model.initSystem()
    for i in range(3):
        state.updU()[i] = top.omega[i]
    manager = osim.Manager(model)
    if "accuracy" in kind:
        manager.setIntegratorAccuracy(float(kind.split()[-1]))
    manager.initialize(state)
    done, com = [0], osim.Vec3(*top.com)

    def step() -> None:
        done[0] += 1
        manager.integrate(done[0] * h)

    def read() -> State:
        now = manager.getState()
        model.realizeVelocity(now)
        q = body.getTransformInGround(now).R().convertRotationToQuaternion()
        place, omega = body.findStationLocationInGround(now, com), body.getAngularVelocityInGround(now)
        return place.to_numpy(), [q.get(i) for i in (1, 2, 3, 0)], omega.to_numpy()

    return stepping(loop(step), read)


def rapier(rapier3d: Any, top: Body, kind: str, h: float) -> Run:
    world = rapier3d.PhysicsWorld(gravity=tuple(top.gravity))
    world.integration_parameters.dt = h
    if kind != "default":
        world.integration_parameters.num_solver_iterations = 32  # default: 4
    mass = rapier3d.MassProperties(tuple(top.com), top.mass, tuple(top.moments), (0, 0, 0, 1))
    description = rapier3d.RigidBody.dynamic().additional_mass_properties(mass).can_sleep(False)
    description = description.allow_fast_rotation(kind != "default")  # without it, at most 45° a substep
    handle = world.add_body(description.linvel(tuple(top.velocity)).angvel(tuple(top.omega)))
    world.rigid_bodies[handle].recompute_mass_properties_from_colliders(world.colliders)
    if not top.free:
        ground = world.add_body(rapier3d.RigidBody.fixed())
        world.impulse_joints.insert(ground, handle, rapier3d.SphericalJointBuilder())

    def read() -> State:
        body = world.rigid_bodies[handle]
        p, q, w = body.center_of_mass, body.rotation, body.angvel
        return (p.x, p.y, p.z), (q.i, q.j, q.k, q.w), (w.x, w.y, w.z)

    return stepping(loop(world.step), read)


def bullet(panda: Any, top: Body, kind: str, h: float) -> Run:
    core = importlib.import_module("panda3d.core")
    world, body = panda.BulletWorld(), panda.BulletRigidBodyNode("top")
    world.setGravity(core.Vec3(*top.gravity))
    body.addShape(panda.BulletSphereShape(0.1))
    body.setMass(top.mass)
    body.setInertia(core.Vec3(*top.moments))
    body.setDeactivationEnabled(False)
    path = core.NodePath(body)
    path.setPos(*top.com)
    world.attachRigidBody(body)
    body.setLinearVelocity(core.Vec3(*top.velocity))
    body.setAngularVelocity(core.Vec3(*top.omega))
    if not top.free:
        world.attachConstraint(panda.BulletSphericalConstraint(body, core.Point3(*(-x for x in top.com))))

    def read() -> State:
        q = path.getQuat()
        return path.getPos(), (q.getI(), q.getJ(), q.getK(), q.getR()), body.getAngularVelocity()

    return stepping(loop(lambda: world.doPhysics(h, 0)), read)


def ode(panda: Any, top: Body, kind: str, h: float) -> Run:
    world, mass = panda.OdeWorld(), panda.OdeMass()
    world.setGravity(*top.gravity)
    if kind != "default":
        world.setErp(0.8)
        world.setCfm(0.0)
    body = panda.OdeBody(world)
    mass.setParameters(top.mass, 0, 0, 0, *top.moments, 0, 0, 0)
    body.setMass(mass)
    body.setPosition(*top.com)
    body.setLinearVel(*top.velocity)
    body.setAngularVel(*top.omega)
    body.setAutoDisableFlag(False)
    joint = None if top.free else panda.OdeBallJoint(world)
    if joint:
        joint.attach(body, None)
        joint.setAnchor(0, 0, 0)

    def read() -> State:
        assert joint or top.free  # keeps the joint alive
        q = body.getQuaternion()
        return body.getPosition(), (q[1], q[2], q[3], q[0]), body.getAngularVel()

    return stepping(loop(lambda: world.step(h)), read)


def sapien(sapien: Any, top: Body, kind: str, h: float) -> Run:
    """PhysX. Its ball joint is a drive whose three displacements are locked."""
    physx = importlib.import_module("sapien.physx")
    config = physx.get_scene_config()
    config.gravity = top.gravity
    physx.set_scene_config(config)
    system = physx.PhysxCpuSystem()
    system.timestep = h
    scene, entity, ground = sapien.Scene([system]), sapien.Entity(), sapien.Entity()
    body, fixed = physx.PhysxRigidDynamicComponent(), physx.PhysxRigidStaticComponent()
    body.set_mass(top.mass)
    body.set_inertia(top.moments)
    body.set_cmass_local_pose(sapien.Pose(top.com))
    if kind != "default":
        body.set_linear_damping(0)
        body.set_angular_damping(0)  # default: 0.05
        body.set_max_angular_velocity(1e4)
    body.set_sleep_threshold(0)
    entity.add_component(body)
    scene.add_entity(entity)
    body.set_linear_velocity(top.velocity)
    body.set_angular_velocity(top.omega)
    if not top.free:
        ground.add_component(fixed)
        scene.add_entity(ground)
        drive = physx.PhysxDriveComponent(body)
        drive.parent = fixed
        for lock in (drive.set_limit_x, drive.set_limit_y, drive.set_limit_z):
            lock(0, 0)
        entity.add_component(drive)

    def read() -> State:
        assert scene  # keeps the scene alive
        pose = body.entity_pose
        return (pose * sapien.Pose(top.com)).p.copy(), np.roll(pose.q, -1), body.angular_velocity.copy()

    return stepping(loop(system.step), read)


EQUAL = "equal relaxation"  # without it, a ball joint gives 4/7 of the torque of its force


def newton(newton: Any, top: Body, kind: str, h: float) -> Run:
    warp = importlib.import_module("warp")
    warp.config.quiet = True
    build = newton.ModelBuilder(gravity=warp.vec3(*top.gravity))
    inertia = warp.mat33(*np.diag(top.moments).ravel().tolist())
    link = build.add_link(mass=top.mass, com=warp.vec3(*top.com), inertia=inertia)
    build.add_articulation([build.add_joint_free(link) if top.free else build.add_joint_ball(-1, link)])
    model = build.finalize()
    name, _, option = kind.partition(", ")
    options: dict[str, dict[str, Any]]
    options = {"": {}, "RK4": {"integrator": "rk4"}, EQUAL: {"joint_angular_relaxation": 0.7}}  # as the linear one
    solver = getattr(newton.solvers, f"Solver{name}")(model, **options[option])
    states, control = [model.state(), model.state()], model.control()
    states[0].joint_qd.assign(np.append(top.velocity, top.omega)[-model.joint_dof_count :])
    newton.eval_fk(model, states[0].joint_q, states[0].joint_qd, states[0])

    def step() -> None:
        states[0].clear_forces()
        solver.step(*states, control, None, h)
        states.reverse()

    def read() -> State:
        place, twist = (part.numpy()[0].copy() for part in (states[0].body_q, states[0].body_qd))  # not views
        return place[:3] + Rotation.from_quat(place[3:]).apply(top.com), place[3:], twist[3:]

    return stepping(loop(step), read)


def node(name: str, _: Any, top: Body, kind: str, h: float) -> Run:
    """A program of `experiments/web`: a process of node follows the body and prints the rows. name : of the program there."""

    def run(steps: int, every: int) -> Iterable[State]:
        facts = {key: value for key, value in top._asdict().items() if key != "case"}
        command = ["node", "follow.mjs", name, kind, repr(h), str(steps), str(every), json.dumps(facts)]
        done = subprocess.run(command, cwd=WEB, capture_output=True, text=True, check=False)
        if done.returncode:
            words = [line for line in done.stderr.splitlines() if "Error" in line]
            raise StepError(f"{name} {kind}", words[0] if words else f"node ended with {done.returncode}")
        rows = np.loadtxt(done.stdout.splitlines(), delimiter=",", skiprows=2, ndmin=2)
        return [(row[1:4], row[4:8], row[8:]) for row in rows]

    return run
