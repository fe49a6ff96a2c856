"""One file per method; `integrators.registry` lists them."""
