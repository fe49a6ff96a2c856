"""A rigid body in Exudyn. A ball joint is a constraint, which only generalized-α has; the other integrators have a free body with
the moments about the fixed point and the torque of the weight, which turns as the top does."""

import exudyn as exu
import numpy as np
from exudyn.utilities import LoadForceVector, MarkerBodyRigid, RigidBodyInertia, SensorBody


def run(body, integrator, h, steps, every):
    mbs, com, weight = exu.SystemContainer().AddSystem(), np.array(body.com), body.mass * np.array(body.gravity)
    has_joint, solver = integrator == "generalized-alpha", integrator.removesuffix(", error control")
    about_point = np.diag(body.moments) + body.mass * (com @ com * np.eye(3) - np.outer(com, com))
    if has_joint:
        inertia = RigidBodyInertia(mass=body.mass, inertiaTensor=np.diag(body.moments))
        start = {"initialVelocity": body.velocity, "initialAngularVelocity": body.omega, "gravity": body.gravity}
        top = mbs.CreateRigidBody(inertia=inertia, referencePosition=com, **start)
        if not body.is_free:
            mbs.CreateSphericalJoint(itemNumbers=[mbs.CreateGround(), top], position=[0, 0, 0])
    else:
        inertia = RigidBodyInertia(mass=body.mass, inertiaTensor=about_point)
        node = exu.NodeType.RotationRotationVector
        top = mbs.CreateRigidBody(inertia=inertia, nodeType=node, initialAngularVelocity=body.omega)
        for place, force in ((com, weight), ([0, 0, 0], -weight)):
            marker = mbs.AddMarker(MarkerBodyRigid(bodyNumber=top, localPosition=place))
            mbs.AddLoad(LoadForceVector(markerNumber=marker, loadVector=force))
    kinds = [getattr(exu.OutputVariableType, name) for name in ("Position", "RotationMatrix", "AngularVelocity")]
    sensors = [mbs.AddSensor(SensorBody(bodyNumber=top, storeInternal=True, outputVariableType=kind)) for kind in kinds]
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = settings.timeIntegration.automaticStepSize = False
    settings.timeIntegration.generalizedAlpha.lieGroupAddTangentOperator = has_joint  # not with rotation vectors
    settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = steps, steps * h
    settings.solution.sensors.writePeriod = every * h
    yield *body.com, *np.eye(3).ravel(), *body.omega
    solver = getattr(exu.DynamicSolverType, "GeneralizedAlpha" if "generalized" in solver else solver)
    mbs.SolveDynamic(settings, solverType=solver, showHints=False)
    place, matrix, omega = (mbs.GetSensorStoredData(sensor)[1:, 1:] for sensor in sensors)
    place = place if has_joint else matrix.reshape(-1, 3, 3) @ com
    yield from np.hstack((place, matrix, omega))
