"""A rigid body in MJX, which is MuJoCo in JAX."""

import jax
import mujoco
import numpy as np
from mujoco import mjx

from lagrange_bench.experiments.engines.mujoco_run import model_of, row


def run(body, integrator, h, steps, every):
    name, _, doubles = integrator.partition(", ")
    jax.config.update("jax_enable_x64", doubles == "doubles")
    jax.clear_caches()  # they hold code of the other precision
    model = model_of(body, name, h)
    data = mujoco.MjData(model)
    data.qvel[-3:] = body.omega
    device_model, state = mjx.put_model(model), mjx.put_data(model, data)
    step = jax.jit(mjx.step)
    for n in range(steps + 1):
        if n:
            state = step(device_model, state)
        if n % every == 0:
            yield row(model, data, np.asarray(state.qpos), np.asarray(state.qvel))
