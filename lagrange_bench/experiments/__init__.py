"""Experiments. Each module asks one question about the methods: it lists cells, measures rows, and draws them."""

EXPERIMENTS = ("drift", "phase", "cost", "work_precision", "perturbed", "ensemble", "engines", "heavy_top", "paper")

PROFILES = ("quick", "full")
