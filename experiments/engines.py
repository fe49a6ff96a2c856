"""The heavy top: multibody codes and engines

How well do programs follow a spinning body? Each integrator of each engine follows the centre of mass and the rotation of
`bruels`, the usual test of multibody codes with 300 rad of spin, and of `slow`, with a fifteenth of the spin, for 2 s. Errors
are those against the exact solution. `bruels` is a stress test: engines are made for slower motions, contacts and many bodies,
of which nothing is measured here. Methods of this bench follow the same tops beside them; among these `backlund` is the
exact step, with the attitude.

Settings: “default” is what an engine does if nobody chooses, “best” is its most accurate integrator here, or its best settings.
All run on one core. A run is timed as a whole, without its set-up (of `backlund` with it); the least of its repeats counts.
The overhead is the time that as many steps of a mass on a rail take: of the engine beside the top, and of the loop in Python
where there is only that.

Engines are no part of the bench: in the clone `pip install '.[engines]'` brings MuJoCo and Exudyn. Drake (`drake`), Pinocchio
(`pin`), PyBullet (`pybullet`) and DART (`dartpy`) install by their own names. Cells of an engine that is not there are skipped.
"""

import importlib
import re
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from importlib import metadata
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from lagrange_bench.experiments import heavy_top, script
from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.measuring.states import rounded
from lagrange_bench.integrators import CASES, integrate, prepare
from lagrange_bench.integrators.cases import Case
from lagrange_bench.integrators.interface import Array, StepError

VERSION = 1
MEASURED = {"": ("position", "rotation", "ns_per_step")}
TIMES = ("version", "date")  # not compared by `verify`, as times are not
UNTIL = 2.0  # s
POWERS = {"bruels": range(10, 17), "slow": range(6, 14)}  # of 2, steps: so many times h is 2 s exactly
REPEATS, ENOUGH = 5, 0.5  # runs of a cell; no more than two if they take so many seconds together
DEFAULT, BEST, OTHER = "default", "best", ""  # settings

# takes n steps; and the centre of mass and the rotation, body to world, that it has then
Running = tuple[Callable[[int], Any], Callable[[], tuple[Any, Any]]]
Start = Callable[[Any, Case, str, float, bool], Running]  # the engine's module, the case, an integrator, h, on a rail?


class Engine(NamedTuple):
    """A program, and how its integrators are made to follow a case.

    start : the adapter. package : its distribution on PyPI, module : the name to import. release : the beginning of the only
    version that is meant, or "". integrators : name → setting; of the bench, whose methods they are, none.
    """

    start: Start
    package: str
    module: str
    integrators: dict[str, str]
    release: str = ""

    @property
    def version(self) -> str | None:
        """Of what is installed here; None if that is not what is meant."""
        try:
            found = metadata.version(self.package)
        except metadata.PackageNotFoundError:
            return None
        return found if found.startswith(self.release) else None


def words(values: Any) -> str:
    return " ".join(map(repr, np.asarray(values, dtype=float).tolist()))


def moments(case: Case) -> Array:
    """(3,), about the centre of mass."""
    return np.diag(case.body.inertia_com)


def loop(step: Callable[[], Any]) -> Callable[[int], None]:
    """n steps, one after the other, in Python."""

    def advance(n: int) -> None:
        for _ in range(n):
            step()

    return advance


def bench(_: Any, case: Case, kind: str, h: float, rail: bool) -> Running:
    if kind == "backlund":  # the exact step; the attitude comes with the rows
        runs: list[Any] = []
        return (
            lambda n: runs.append(integrate(case.body, case.state, h=h, steps=n, method=kind).rotation[-1]),
            lambda: (runs[-1].apply(case.body.com), runs[-1].as_matrix()),
        )
    body, y0 = heavy_top.motion(case.name)
    stepper, y = prepare(body, y0, h, kind), [y0]

    def read() -> tuple[Any, Any]:
        turn = body.rotations(y[-1:])[0]
        return turn.apply(body.com), turn.as_matrix()

    return lambda n: y.append(stepper.advance(y0, n)), read


def mujoco(mj: Any, case: Case, kind: str, h: float, rail: bool) -> Running:
    top = case.body
    model = mj.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{h!r}" integrator="{kind}" gravity="{words(top.gravity)}"/>
        <worldbody><body><joint type="{"slide" if rail else "ball"}"/>
        <inertial pos="{words(top.com)}" mass="{top.mass!r}" diaginertia="{words(moments(case))}"/>
        </body></worldbody></mujoco>""")
    data = mj.MjData(model)
    mj.set_mju_user_warning(lambda text: None)  # it would write a file; the counters are read below
    if not rail:
        data.qvel[:] = case.omega_body

    def read() -> tuple[Any, Any]:
        if any(warning.number for warning in data.warning):
            raise StepError(f"mujoco {kind}", "the engine met huge numbers, warned, and began anew")
        mj.mj_forward(model, data)
        return data.xipos[1], data.xmat[1].reshape(3, 3)

    return lambda n: mj.mj_step(model, data, n), read


DISCRETE, CONTROLLED = "discrete", ", error control"
EXPLICIT = ("RK44", f"DOPRI5{CONTROLLED}", "RK67")  # no step size is fixed for the second: h is the largest


def exudyn(exu: Any, case: Case, kind: str, h: float, rail: bool) -> Running:
    """A ball joint is a constraint. What needs an ordinary differential equation has a free body with the moments about the
    fixed point, and the torque of the weight: its rotation is that of the top."""
    importlib.import_module("exudyn.utilities")
    tools, top, mbs = exu.utilities, case.body, exu.SystemContainer().AddSystem()
    mass, com, weight = top.mass, np.asarray(top.com), top.mass * np.asarray(top.gravity)
    inertia, joint = np.diag(moments(case)), kind == "generalized-alpha"
    if not joint:
        inertia = inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
    facts = {
        "inertia": tools.RigidBodyInertia(mass=mass, inertiaTensor=inertia),
        "initialAngularVelocity": case.omega_body,
    }
    if rail:
        body = mbs.CreateMassPoint(physicsMass=mass, initialVelocity=[1, 0, 0])
    elif joint:
        speed = np.cross(np.asarray(case.omega_body), com)
        body = mbs.CreateRigidBody(referencePosition=com, initialVelocity=speed, gravity=top.gravity, **facts)
        mbs.CreateSphericalJoint(itemNumbers=[mbs.CreateGround(), body], position=[0, 0, 0])
    else:
        body = mbs.CreateRigidBody(nodeType=exu.NodeType.RotationRotationVector, **facts)
        for place, force in ((com, weight), ([0, 0, 0], -weight)):
            marker = mbs.AddMarker(tools.MarkerBodyRigid(bodyNumber=body, localPosition=place))
            mbs.AddLoad(tools.LoadForceVector(markerNumber=marker, loadVector=force))
    mbs.Assemble()
    settings, output = exu.SimulationSettings(), exu.OutputVariableType
    settings.solution.file.write = settings.timeIntegration.automaticStepSize = False
    settings.timeIntegration.generalizedAlpha.lieGroupAddTangentOperator = joint  # not with a vector of rotation
    name = kind.removesuffix(CONTROLLED) if kind in EXPLICIT else "GeneralizedAlpha"
    solver = getattr(exu.DynamicSolverType, name)

    def advance(n: int) -> None:
        settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = n, n * h
        mbs.SolveDynamic(settings, solverType=solver, showHints=False)

    def read() -> tuple[Any, Any]:
        matrix = mbs.GetObjectOutputBody(body, output.RotationMatrix, [0, 0, 0]).reshape(3, 3)
        return mbs.GetObjectOutputBody(body, output.Position, [0, 0, 0]) if joint else matrix @ com, matrix

    return advance, read


def drake(pydrake: Any, case: Case, kind: str, h: float, rail: bool) -> Running:
    """The turned frames make the spin the roll. The joint is singular along z of its frame: where the axis comes least near."""
    every = importlib.import_module("pydrake.all")
    top, com = case.body, np.asarray(case.body.com)
    angles = np.linspace(0.0, np.pi, 37)
    across = np.stack((np.cos(angles), np.zeros(37), np.sin(angles)))
    z = across[:, np.argmin(np.max(np.abs(case.solution(np.linspace(0.0, UNTIL, 2001)).position @ across), axis=0))]
    plant = every.MultibodyPlant(h if kind == DISCRETE else 0.0)
    inertia = every.RotationalInertia(*moments(case))
    body = plant.AddRigidBody("top", every.SpatialInertia.MakeFromCentralInertia(top.mass, com, inertia))
    turned = every.RigidTransform(every.RotationMatrix(np.column_stack((com, np.cross(z, com), z))))
    ends = ("joint", plant.world_frame()), ("body", body.body_frame())
    frames = [plant.AddFrame(every.FixedOffsetFrame(*end, turned)) for end in ends]
    slide = every.PrismaticJoint("slide", *frames, [1, 0, 0]) if rail else every.BallRpyJoint("ball", *frames)
    joint = plant.AddJoint(slide)
    plant.mutable_gravity_field().set_gravity_vector(top.gravity)
    plant.Finalize()
    simulator = every.Simulator(plant)
    context = simulator.get_mutable_context()
    if not rail:
        joint.set_angular_velocity(context, turned.rotation().matrix().T @ case.omega_body)
    if kind != DISCRETE:
        scheme, controlled = kind.removesuffix(CONTROLLED), kind.endswith(CONTROLLED)
        choice = every.SimulatorConfig(integration_scheme=scheme, max_step_size=h, use_error_control=controlled)
        every.ApplySimulatorConfig(choice, simulator)
    simulator.Initialize()

    def read() -> tuple[Any, Any]:
        pose = plant.EvalBodyPoseInWorld(context, body)
        return pose.multiply(com), pose.rotation().matrix()

    return lambda n: simulator.AdvanceTo(context.get_time() + n * h), read


def pinocchio(pin: Any, case: Case, kind: str, h: float, rail: bool) -> Running:
    """It has the dynamics (`aba`) and the exponential map (`integrate`), but no integrator: the loops are written here."""
    top, model = case.body, pin.Model()
    number = model.addJoint(0, pin.JointModelPX() if rail else pin.JointModelSpherical(), pin.SE3.Identity(), "joint")
    inertia = pin.Inertia(top.mass, np.asarray(top.com), np.diag(moments(case)))
    model.appendBodyToJoint(number, inertia, pin.SE3.Identity())
    model.gravity.linear = np.asarray(top.gravity)
    data, torque = model.createData(), np.zeros(model.nv)
    state = [pin.neutral(model), np.ones(1) if rail else np.array(case.omega_body, dtype=float)]

    def euler(q: Array, v: Array) -> list[Any]:
        v = v + h * pin.aba(model, data, q, v, torque)
        return [pin.integrate(model, q, h * v), v]

    def rkmk4(q: Array, v: Array) -> list[Any]:
        def slope(u: Array, v: Array) -> Array:  # of the logarithm, with the first terms of dexp⁻¹, and of v
            if not rail:
                turn = pin.skew(u)
                w = turn @ v
            rate = v if rail else v + w / 2.0 + turn @ w / 12.0
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

    def read() -> tuple[Any, Any]:
        pin.forwardKinematics(model, data, state[0])
        return data.oMi[number].act(np.asarray(top.com)), data.oMi[number].rotation

    return loop(once), read


def pybullet(pb: Any, case: Case, kind: str, h: float, rail: bool) -> Running:
    top = case.body
    if pb.isConnected():
        pb.disconnect()
    pb.connect(pb.DIRECT)
    pb.setGravity(*top.gravity)
    pb.setTimeStep(h)
    nothing = {"linkCollisionShapeIndices": [-1], "linkVisualShapeIndices": [-1], "linkPositions": [[0, 0, 0]]}
    frames = {"linkInertialFramePositions": [top.com], "linkJointAxis": [[1, 0, 0]], "linkParentIndices": [0]}
    turns = {"linkOrientations": [[0, 0, 0, 1]], "linkInertialFrameOrientations": [[0, 0, 0, 1]]}
    joint = {"linkJointTypes": [pb.JOINT_PRISMATIC if rail else pb.JOINT_SPHERICAL], "linkMasses": [top.mass]}
    body = pb.createMultiBody(0, -1, -1, **nothing, **frames, **turns, **joint)
    pb.changeDynamics(body, 0, localInertiaDiagonal=list(moments(case)))
    if kind == "Euler, undamped":
        pb.changeDynamics(body, 0, linearDamping=0, angularDamping=0, jointDamping=0, maxJointVelocity=1e9)
    if not rail:  # a motor holds every joint unless it is told not to
        still = {"targetPosition": [0, 0, 0, 1], "positionGain": 0, "velocityGain": 0, "force": [0, 0, 0]}
        pb.setJointMotorControlMultiDof(body, 0, pb.POSITION_CONTROL, **still)
        pb.resetJointStateMultiDof(body, 0, [0, 0, 0, 1], np.asarray(case.omega_body).tolist())

    def read() -> tuple[Any, Any]:
        link = pb.getLinkState(body, 0, computeForwardKinematics=1)
        return link[0], np.reshape(pb.getMatrixFromQuaternion(link[5]), (3, 3))

    return loop(pb.stepSimulation), read


def dart(dartpy: Any, case: Case, kind: str, h: float, rail: bool) -> Running:
    top, world, skeleton = case.body, dartpy.simulation.World(), dartpy.dynamics.Skeleton()
    world.setGravity(list(top.gravity))
    world.setTimeStep(h)
    made = skeleton.createPrismaticJointAndBodyNodePair if rail else skeleton.createBallJointAndBodyNodePair
    body = made()[1]
    body.setInertia(dartpy.dynamics.Inertia(top.mass, np.asarray(top.com), np.diag(moments(case))))
    world.addSkeleton(skeleton)
    if not rail:
        skeleton.setVelocities(np.asarray(case.omega_body))

    return loop(world.step), lambda: (body.getCOM(), body.getTransform().rotation())


OURS = "lagrange-bench"
METHODS = ("backlund", "strang", "rkmk4", "rattle", "generalized_alpha")
_KINDS = {
    "MuJoCo": {"Euler": DEFAULT, "implicit": OTHER, "RK4": BEST},
    "Exudyn": {"generalized-alpha": DEFAULT, "generalized-alpha, Lie group": OTHER, **dict.fromkeys(EXPLICIT, OTHER)},
    "Drake": {DISCRETE: DEFAULT, f"runge_kutta3{CONTROLLED}": DEFAULT, "runge_kutta2": OTHER, "runge_kutta3": OTHER},
}
ENGINES = {
    OURS: Engine(bench, OURS, "lagrange_bench", {}),
    "MuJoCo": Engine(mujoco, "mujoco", "mujoco", _KINDS["MuJoCo"]),
    "MuJoCo 3": Engine(mujoco, "mujoco", "mujoco", {"RK4": BEST}, release="3."),
    "Exudyn": Engine(exudyn, "exudyn", "exudyn", _KINDS["Exudyn"] | {"RK67": BEST}),
    "Drake": Engine(drake, "drake", "pydrake", _KINDS["Drake"] | {"radau3": OTHER, "runge_kutta5": BEST}),
    "Pinocchio": Engine(pinocchio, "pin", "pinocchio", {"semi-implicit Euler": OTHER, "RKMK4": BEST}),
    "PyBullet": Engine(pybullet, "pybullet", "pybullet", {"Euler": DEFAULT, "Euler, undamped": BEST}),
    "DART": Engine(dart, "dartpy", "dartpy", {"Euler": DEFAULT}),
}


def cells(profile: str) -> list[dict]:
    """The quick profile has the methods of the bench alone: it never needs an engine."""
    full = profile == "full"
    who = [{"engine": OURS, "method": method} for method in METHODS]
    for name, engine in ENGINES.items() if full else ():
        who += [{"engine": name, "integrator": kind, "setting": how} for kind, how in engine.integrators.items()]
    steps = [(case, k) for case, powers in POWERS.items() for k in (powers if full else powers[:-2:2])]
    return [{"timing": True, "case": case, **one, "h": UNTIL / 2**k} for one in who for case, k in steps]


def lacks(cell: dict) -> str | None:
    """The package that a cell needs, if it is not installed here in the version that is meant."""
    engine = ENGINES.get(cell.get("engine", ""))
    if engine is None or engine.module == "lagrange_bench" or engine.version:
        return None
    return engine.package + f"=={engine.release}*" * bool(engine.release)


def timed(engine: Engine, case: Case, kind: str, h: float, steps: int, rail: bool) -> tuple[float, Any]:
    """The least time of a run, s, and what can be read at its end."""
    module, read = importlib.import_module(engine.module), None
    samples: list[float] = []
    while len(samples) < 2 or (len(samples) < REPEATS and sum(samples) < ENOUGH):
        advance, read = engine.start(module, case, kind, h, rail)
        begin = perf_counter()
        try:
            advance(steps)
        except Exception as error:  # what an engine raises here is its refusal, and a result
            raise StepError(f"{engine.module} {kind}", re.split(r"\n|\. ", str(error).strip())[0]) from error
        samples.append(perf_counter() - begin)
    return min(samples), read


def measure(cell: dict) -> list[dict]:
    engine, case, h = ENGINES[cell["engine"]], CASES[cell["case"]], cell["h"]
    kind, steps = cell.get("method") or cell["integrator"], round(UNTIL / h)
    seconds, read = timed(engine, case, kind, h, steps, rail=False)
    found, matrix = (np.array(part, dtype=float) for part in read())
    if not (np.isfinite(found).all() and np.isfinite(matrix).all()):
        raise StepError(f"{engine.module} {kind}", "the numbers at the end are not finite")
    right = heavy_top.end(cell["case"])
    off = Rotation.from_matrix(right).inv() * Rotation.from_matrix(matrix)
    row = {
        "position": rounded(float(np.linalg.norm(found - right @ case.body.com))),
        "rotation": rounded(float(off.magnitude())),
        "ns_per_step": rounded(seconds / steps * 1e9),
        "version": engine.version or "",
        "date": datetime.now(UTC).date().isoformat(),
    }
    if cell["engine"] != OURS:
        row["overhead_ns_per_step"] = rounded(timed(engine, case, kind, h, steps, rail=True)[0] / steps * 1e9)
    return [row]


SHOWN = 1 / 1024  # s, a step at which errors are told beside those with the smallest


def runs(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the name of each integrator, or method, in one column, and the seconds of a run."""
    wanted = ("integrator", "method", "setting", "overhead_ns_per_step", "until")
    rows = rows.reindex(columns=list(dict.fromkeys((*rows.columns, *wanted))))
    named = rows.integrator.astype(object).fillna(rows.method)
    seconds = rows.ns_per_step * 1e-9 * UNTIL / rows.h if "ns_per_step" in rows else np.nan
    return rows.assign(integrator=named, setting=rows.setting.astype(object).fillna(""), seconds=seconds)


OVERVIEW = {"1/60 s": 1 / 60, "1/1024 s": 1 / 1024}  # steps, s


def overview(rows: pd.DataFrame) -> pd.DataFrame:
    """How well engines follow `slow`, with their default and their best settings.

    Parameters
    ----------
    rows : DataFrame
        As stored, of the experiment `engines`.

    Returns
    -------
    DataFrame
        A line for each engine and setting. `engine` with its version; `setting`, with the integrator; "1/60 s", "1/1024 s":
        the error of the centre of mass after 2 s with these steps, m (NaN: it gave up, or was not measured); `until`: how long
        it is within 10 cm with steps of 1/60 s, s; `limit`: what motion it tends to as the steps get smaller.
    """
    good = runs(rows[rows.status == "done"]).drop_duplicates(["case", "engine", "integrator", "h"], keep="last")
    lines = []
    for (engine, kind), group in good[good.setting.isin((DEFAULT, BEST))].groupby(["engine", "integrator"], sort=False):
        slow = group[group.case == "slow"].set_index("h").sort_index(ascending=False)
        if not slow.empty:
            line = {"engine": f"{engine}, {slow.version.iloc[-1]}", "setting": f"{slow.setting.iloc[-1]}: {kind}"}
            line |= {name: slow.position.get(h, np.nan) for name, h in OVERVIEW.items()}
            lines.append({**line, "until": slow.until.get(1 / 60, np.nan), "limit": limit(slow)})
    return pd.DataFrame(lines, columns=["engine", "setting", *OVERVIEW, "until", "limit"])


def limit(slow: pd.DataFrame) -> str:
    """What motion the runs of one integrator tend to, from those with the two smallest steps."""
    if len(slow) < 2:
        return ""
    (h, coarse), (k, fine) = slow.position.iloc[-2:].items()
    order = np.log(coarse / fine) / np.log(h / k) if fine else np.inf
    return "another motion" if order < 0.3 and fine > 0.05 else "the exact motion"


CAPTION = (
    "The heavy top in multibody codes and engines: measured orders of position and rotation; errors (m, rad) with steps of "
    "1/1024 s and with the smallest; the time of a step, and what a step of a mass on a rail takes. No order: too few errors "
    "below 0.1, or all at round-off"
)


@by_group(("case", "engine", "integrator"), "", CAPTION)
def orders(case: str, engine: str, kind: str, group: pd.DataFrame) -> dict:
    last, at, quantities = group.loc[group.h.idxmin()], group[group.h == SHOWN], ("position", "rotation")
    line = {"setting": last.setting, "version": last.version, "measured": last.date, **heavy_top.measured_orders(group)}
    line |= {f"{name}, h = 1/1024": at[name].iloc[0] if len(at) else np.nan for name in quantities}
    line |= {"smallest h": last.h} | {f"{name} there": last[name] for name in quantities}
    return line | {"ns per step": group.ns_per_step.min(), "of these overhead": group.overhead_ns_per_step.min()}


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    return tabulated(orders)(runs(rows))


COLOURS = ("#1A1A1A", "#0072B2", "#56B4E9", "#D55E00", "#009E73", "#CC79A7", "#C78900", "#7A5400")
NEUTRAL = "#8F8F8F"  # of an engine that has rows, and is no longer listed
MARKERS = ("o", "s", "D", "^", "v")


def looks(rows: pd.DataFrame, style) -> dict[tuple[str, str], dict]:
    """Of each engine and integrator: the bench's methods, the best and the defaults bold and named, others thin."""
    found, colours = {}, dict(zip(ENGINES, COLOURS, strict=False))
    for (name, kind), group in rows.groupby(["engine", "integrator"], sort=False):
        setting, ours = group.setting.iloc[0], name == OURS
        text = style.label(kind) if ours else f"{name}, {kind}"
        look = {"color": colours.get(name, NEUTRAL), "linestyle": "--" if setting == DEFAULT else "-"}
        if ours or setting:
            kinds = METHODS if ours else tuple(getattr(ENGINES.get(name), "integrators", ()))
            marker = MARKERS[kinds.index(kind) % len(MARKERS)] if kind in kinds else "none"
            found[name, kind] = {**look, "label": style.plain(text), "marker": marker, "markersize": 3.0}
        else:
            found[name, kind] = {**look, "label": "_thin", "gid": style.title(text), "linewidth": 0.6, "alpha": 0.7}
    return found


@of_part(failed=True)
def _draw_steps(rows: pd.DataFrame, style, rest: bool = False):
    """The bench and the best of each engine; or the rest of their integrators."""
    rows = runs(rows)
    rows = rows[(rows.engine.ne(OURS) & rows.setting.ne(BEST)) == rest]
    if rows.empty:
        return None
    cases = [case for case in POWERS if case in set(rows.case)]
    fig, grid = style.figure("page", 0.9 + 2.3 * len(cases), nrows=len(cases), ncols=2, sharey="row", squeeze=False)
    columns = {"h": "step, s", "seconds": "wall time of the run, s"}
    for line, case in zip(grid, cases, strict=True):
        for ax, (column, text) in zip(line, columns.items(), strict=True):
            for (name, kind), look in looks(rows, style).items():
                run = rows[(rows.case == case) & (rows.engine == name) & (rows.integrator == kind)]
                good = run[run.status == "done"].sort_values("h")
                if not good.empty:
                    ax.loglog(good[column], good.position.clip(lower=1e-16), **look)
            ax.set(xlabel=text, title=f"{case}, t = {UNTIL:g} s")
        line[0].set_ylabel("error of position, m")
        style.failure_marks(line[0], rows[(rows.case == case) & (rows.status == "failed")].h.unique())
    style.legend_below(fig)
    which = (
        "Black: methods of this bench; in colour: the most accurate integrator, or the best settings, of each engine",
        "The rest. Dashed: default settings; thin: other integrators, in their engine's colour",
    )
    fig.caption = (
        "Error of the centre of mass at the end against the step, and against the wall time of the whole run on one core; down "
        f"and left is better. {which[rest]}. Crosses: steps at which an engine gave up."
    )
    return fig


draw = drawn(steps=_draw_steps, defaults=partial(_draw_steps, rest=True))

if __name__ == "__main__":
    script.run("engines")
