"""A rigid body in MuJoCo."""

import mujoco


def model_of(body, integrator, h):
    words = {name: " ".join(map(repr, getattr(body, name))) for name in ("gravity", "com", "moments")}
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{h!r}" integrator="{integrator}" gravity="{words["gravity"]}"/>
        <worldbody><body><joint type="{"free" if body.is_free else "ball"}"/>
        <inertial pos="{words["com"]}" mass="{body.mass!r}" diaginertia="{words["moments"]}"/>
        </body></worldbody></mujoco>""")


def row(model, data, q, v):
    """The row at coordinates q, with the scalar of the quaternion first, and velocities v of the joint."""
    data.qpos[:], data.qvel[:] = q, v
    mujoco.mj_forward(model, data)
    return *data.xipos[1], *q[-3:], q[-4], *data.cvel[1][:3]


def run(body, integrator, h, steps, every):
    model = model_of(body, integrator, h)
    data = mujoco.MjData(model)
    data.qvel[-3:] = body.omega
    mujoco.set_mju_user_warning(lambda text: None)  # a warning would write a file; its counter is read below
    for n in range(steps // every + 1):
        if n:
            mujoco.mj_step(model, data, every)
        if any(warning.number for warning in data.warning):
            raise RuntimeError("the engine met huge numbers, warned, and began anew")
        mujoco.mj_forward(model, data)
        yield *data.xipos[1], *data.xmat[1], *data.cvel[1][:3]
