"""Runs the cells of experiments, here or on a cluster, and stores each cell when it is done."""
