"""The paper's mathematics, section by section; `docs/equations.md` goes through it equation by equation.

    1         phase_space                                          states, brackets, equations of motion, invariants
    2         lax; gaudin_model, gaudin_curve; contraction         Lax matrices, curve; the magnet; two sites become the top
    3         separation                                           separation of variables
    4         euler_angles                                         the motion by ℘, ζ and σ
    5.1       one_point                                            the one-point map
    5.2, 5.3  generating_functions                                 it is symplectic; spectrality
    5.4       eulerian                                             the one-point map in Euler angles
    5.5       two_point                                            the two-point map
    5.6       interpolating_flow                                   its time step and the flow it interpolates
    rivals    discrete_lax                                         the discrete tops of others, as two-point maps
    n sites   gaudin_maps, gaudin_doubling                         both maps of the magnet, and its exact step

`errata` gathers the misprints. Nothing imports this package but its own commands, its experiment and its tests (the layers in
pyproject.toml say so); `GaudinMagnet` is a public name.
"""
