"""Predicts the phase errors of methods by backward error analysis, from power series of their steps."""
