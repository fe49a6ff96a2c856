"""Tiny experiments for the tests of the engine; a package, so that worker processes can import them."""
