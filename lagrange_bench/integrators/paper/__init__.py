"""The mathematics of the paper as code that runs, section by section. `docs/equations.md` lists it by equation.

    1         phase_space                                          states, brackets, equations of motion, invariants
    2         lax; gaudin_model, gaudin_curve; contraction         Lax matrices, curve; the magnet; two sites become the top
    3         separation                                           separation of variables
    4         euler_angles                                         the motion by ℘, ζ and σ
    5.1       one_point                                            the one-point map
    5.2, 5.3  generating_functions                                 it is symplectic; spectrality
    5.4       eulerian                                             the one-point map in Euler angles
    5.5       two_point                                            the two-point map
    5.6       interpolating_flow                                   its time step and the flow it interpolates
    rivals    discrete_lax                                         discrete tops by others, as two-point maps
    n sites   gaudin_maps, gaudin_doubling                         both maps of the magnet, and its exact step

`errata` collects the misprints. Only the paper's own commands, experiment and tests import this package (a contract in
pyproject.toml). `GaudinMagnet` is a public name.
"""
