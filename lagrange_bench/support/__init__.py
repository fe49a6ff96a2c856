"""What all rooms need and has nothing to do with integrators: files, messages, interrupts, and which source code runs."""
