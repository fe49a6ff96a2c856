"""A rigid body in PyBullet. A top is a link in a spherical joint; a motor holds every joint until it is switched off."""

import pybullet as pb


def run(body, integrator, h, steps, every):
    if pb.isConnected():
        pb.disconnect()
    pb.connect(pb.DIRECT)
    pb.setGravity(*body.gravity)
    pb.setTimeStep(h)
    if body.is_free:
        top, link = pb.createMultiBody(body.mass), -1
    else:
        shapes = {"linkCollisionShapeIndices": [-1], "linkVisualShapeIndices": [-1], "linkPositions": [[0, 0, 0]]}
        frame = {"linkInertialFramePositions": [body.com], "linkInertialFrameOrientations": [[0, 0, 0, 1]]}
        joint = {"linkJointTypes": [pb.JOINT_SPHERICAL], "linkJointAxis": [[1, 0, 0]], "linkParentIndices": [0]}
        turn = {"linkOrientations": [[0, 0, 0, 1]], "linkMasses": [body.mass]}
        top, link = pb.createMultiBody(0, -1, -1, **shapes, **frame, **joint, **turn), 0
    pb.changeDynamics(top, link, localInertiaDiagonal=body.moments)
    if integrator == "Euler, undamped":
        pb.changeDynamics(top, link, linearDamping=0, angularDamping=0, jointDamping=0, maxJointVelocity=1e9)
    if body.is_free:
        pb.resetBaseVelocity(top, angularVelocity=body.omega)
    else:
        motor = {"positionGain": 0, "velocityGain": 0, "force": [0, 0, 0]}
        pb.setJointMotorControlMultiDof(top, 0, pb.POSITION_CONTROL, targetPosition=[0, 0, 0, 1], **motor)
        pb.resetJointStateMultiDof(top, 0, [0, 0, 0, 1], body.omega)
    for n in range(steps + 1):
        if n:
            pb.stepSimulation()
        if n % every == 0 and body.is_free:
            position, quaternion = pb.getBasePositionAndOrientation(top)
            yield *position, *quaternion, *pb.getBaseVelocity(top)[1]
        elif n % every == 0:
            state = pb.getLinkState(top, 0, computeForwardKinematics=1, computeLinkVelocity=1)
            yield *state[0], *state[5], *state[7]
