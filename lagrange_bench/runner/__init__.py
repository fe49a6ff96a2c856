"""Runs the cells of experiments, here or on a cluster, and stores each as it is finished."""
