"""Experiments. Each module asks one question about the methods and measures rows; `…_figures` beside it draws them."""

EXPERIMENTS = (
    "drift", "phase", "cost", "work_precision", "perturbed",
    "ensemble", "engines", "heavy_top", "paper",
)  # fmt: skip

PROFILES = ("quick", "full")
