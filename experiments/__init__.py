"""Experiments. Each file asks one question about the methods, measures rows, and draws them."""

EXPERIMENTS = (
    "drift", "phase", "cost", "work_precision", "perturbed",
    "ensemble", "engines", "heavy_top", "paper",
)  # fmt: skip

PROFILES = ("quick", "full")
