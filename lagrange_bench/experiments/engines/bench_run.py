"""A rigid body in this bench, by one of its methods."""

import numpy as np

from lagrange_bench.integrators import integrate, prepare


def run(body, method, h, steps, every):
    rigid_body, y0 = body.case.body, body.case.state
    stepper = prepare(rigid_body, y0, h, method)
    yield *body.com, *np.eye(3).ravel(), *body.omega
    if method == "backlund":  # the exact step; the attitude comes with the rows
        exact = integrate(rigid_body, y0, h=h, steps=steps, method=method, every=every)
        matrices = exact.rotation.as_matrix().reshape(-1, 9)
        yield from np.hstack((exact.position, matrices, exact.omega_world))[1:]
        return
    for n in range(every, steps + 1, every):
        y = stepper.advance(y0, n)[None]
        turn = rigid_body.rotations(y)[0]
        yield *turn.apply(body.com), *turn.as_matrix().ravel(), *turn.apply(rigid_body.angular_velocity(y)[0])
