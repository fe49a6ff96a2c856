"""Tools of measurement: initial states, metrics, timing, checks of claims, golden bits."""
