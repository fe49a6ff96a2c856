"""Help for all rooms that is not about integrators: files, messages, interrupts, and digests of source code."""
