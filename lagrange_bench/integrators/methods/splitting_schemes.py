"""Coefficients of splitting schemes for H = A + B, a rotation A and a kick B.

`SCHEMES` lists them by name, each with its source. `splitting` applies them to a top, `part_splitting` to any parts of H.
"""

import math
from typing import NamedTuple


class Scheme(NamedTuple):
    """Coefficients of one step, `a` of the rotations and `b`, `c`, `d` of the kicks; all are palindromes."""

    order: int
    first: str  # the first letter: "A" rotation, "B" kick
    a: tuple[float, ...]
    b: tuple[float, ...]
    source: str
    c: tuple[float, ...] = ()
    d: tuple[float, ...] = ()
    is_nystrom: bool = False  # it has this order only because [B,[B,[B,A]]] = 0
    second: float = 0.0  # of the corrector, see `backlund_schemes`


def mirror(half: tuple[float, ...], n: int) -> tuple[float, ...]:
    """A palindrome of n numbers from its first half with the middle one."""
    return (*half, *half[: n // 2][::-1])


def palindrome(first: tuple[float, ...], n: int) -> tuple[float, ...]:
    """A palindrome of n numbers with sum 1, from its first half without the last (or middle) one."""
    rest = math.fsum((1.0, *(-2 * w for w in first)))
    return mirror((*first, rest if n % 2 else rest / 2), n)


def composition(order: int, source: str, first: tuple[float, ...]) -> Scheme:
    """Strang steps of lengths w h. first : the w before the middle one."""
    w = palindrome(first, 2 * len(first) + 1)
    return Scheme(order, "B", w, tuple((p + q) / 2 for p, q in zip((0.0, *w), (*w, 0.0), strict=True)), source)


KAHAN_LI = "Kahan and Li, Math. Comp. 66 (1997) 1089"
BLANES_MOAN = "Blanes and Moan, J. Comput. Appl. Math. 142 (2002) 313"
GRADIENTS = "Omelyan, Mryglod and Folk, Phys. Rev. E 66 (2002) 026701"

SCHEMES = {
    "strang": composition(2, "Strang, SIAM J. Numer. Anal. 5 (1968) 506", ()),
    "blanes_moan4": Scheme(
        4, "B",
        palindrome((0.245298957184271, 0.604872665711080), 6),
        palindrome((0.0829844064174052, 0.396309801498368, -0.0390563049223486), 7),
        f"{BLANES_MOAN}, SRKN6b",
    ),
    # two conditions for a1, b1, c1, c2; b1 and c1 make the error of degree 5 least
    "force_gradient4": Scheme(
        4, "B",
        palindrome((0.27377798630646189,), 3),
        palindrome((0.080868,), 4),
        f"class of {GRADIENTS}; coefficients: this project",
        c=mirror((0.000232, 0.0029821796916614993), 4),
    ),
    "blanes_moan6": Scheme(
        6, "A",
        palindrome((0.0378593198406116, 0.102635633102435, -0.0258678882665587, 0.314241403071447, -0.130144459517415,
                    0.106417700369543, -0.00879424312851058), 15),
        palindrome((0.09171915262446165, 0.183983170005006, -0.05653436583288827, 0.004914688774712854,
                    0.143761127168358, 0.328567693746804), 14),
        f"{BLANES_MOAN}, SRKN14a", is_nystrom=True,
    ),
    "force_gradient6": Scheme(
        6, "A",
        palindrome((0.10951155775140214, 0.44517150809552086), 5),
        palindrome((0.26872220820482184,), 4),
        f"class of {GRADIENTS}; coefficients: this project",
        c=mirror((0.0008056816670964243, 0.003955911930041659), 4),
        d=mirror((1.935749212896712e-05, 5.0722352657284275e-05), 4), is_nystrom=True,
    ),
    "kahan_li8": composition(
        8, KAHAN_LI,
        (0.13020248308889008087881763, 0.56116298177510838456196441, -0.38947496264484728640807860,
         0.15884190655515560089621075, -0.39590389413323757733623154, 0.18453964097831570709183254,
         0.25837438768632204729397911, 0.29501172360931029887096624),
    ),
}  # fmt: skip
