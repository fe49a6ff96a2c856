"""One file per method; `registry` lists them."""
