"""A rigid body in MuJoCo Warp, which is MuJoCo for graphics cards."""

import mujoco
import mujoco_warp
import warp

from lagrange_bench.experiments.engines.mujoco_run import model_of, row


def run(body, integrator, h, steps, every):
    warp.config.quiet = True
    model = model_of(body, integrator, h)
    data = mujoco.MjData(model)
    data.qvel[-3:] = body.omega
    mujoco.mj_forward(model, data)
    device_model, state = mujoco_warp.put_model(model), mujoco_warp.put_data(model, data)
    for n in range(steps + 1):
        if n:
            mujoco_warp.step(device_model, state)
        if n % every == 0:
            yield row(model, data, state.qpos.numpy()[0], state.qvel.numpy()[0])
