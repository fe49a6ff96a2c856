"""Experiments: each file asks one question of the methods, measures rows, and draws them."""
