"""One file per method; their records, in legend order."""

# name → module:RECORD
BUILT_IN = {
    # backlund
    "backlund": "backlund:EXACT",
    "backlund_unpinned": "backlund:UNPINNED",
    "backlund_paper": "backlund:PAPER",
    "backlund_textbook": "backlund_textbook:METHOD",
    "backlund_splitting": "backlund_splitting:METHOD",
    # closed-form
    "addition_theorem": "addition_theorem:METHOD",
    "theta_functions": "theta_functions:METHOD",
    # taylor
    "taylor": "taylor:NATURAL",
    "taylor_fixed": "taylor_fixed:METHOD",
    # runge-kutta
    "rk4": "runge_kutta:CLASSICAL",
    "rk45_fixed": "runge_kutta:FIFTH",
    "dop853_fixed": "runge_kutta:EIGHTH",
    "verner9_fixed": "runge_kutta:NINTH",
    "verner9_projected": "runge_kutta:PROJECTED",
    "dop853": "dop853:METHOD",
    "rk45": "scipy_ivp:RK45",
    # splitting
    "strang": "splitting:STRANG",
    "blanes_moan4": "splitting:BLANES_MOAN4",
    "force_gradient4": "splitting:FORCE_GRADIENT4",
    "blanes_moan6": "splitting:BLANES_MOAN6",
    "force_gradient6": "splitting:FORCE_GRADIENT6",
    "kahan_li8": "splitting:KAHAN_LI8",
    # integrable
    "kahan": "kahan:METHOD",
    "bobenko_suris": "bobenko_suris:METHOD",
    # implicit
    "implicit_midpoint": "implicit_midpoint:METHOD",
    "gauss4": "gauss:GAUSS4",
    "gauss6": "gauss:GAUSS6",
    "gauss8": "gauss:GAUSS8",
    # lie-group
    "rkmk4": "lie_group:RKMK4",
    # whole-body
    "rattle": "whole_body:RATTLE",
    "simo_wong": "whole_body:SIMO_WONG",
    "lie_midpoint": "whole_body:LIE_MIDPOINT",
    "generalized_alpha": "whole_body:GENERALIZED_ALPHA",
}

# Each of these has a better, or better known, method in its family. Their rows and claims are kept; figures and quick runs of
# many methods leave them out.
ARCHIVE = frozenset(
    [
        "backlund_unpinned",
        "backlund_paper",
        "backlund_textbook",
        "taylor_fixed",
        "rk45_fixed",
        "dop853_fixed",
        "force_gradient4",
        "gauss4",
        "gauss6",
        "lie_midpoint",
    ]
)
