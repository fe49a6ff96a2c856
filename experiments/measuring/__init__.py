"""What experiments measure with: initial states, metrics, timing, the claims of a method, golden bits."""
