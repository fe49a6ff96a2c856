"""The paper's mathematics, in the paper's order; off the hot path."""
