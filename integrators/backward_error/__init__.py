"""What backward error analysis says of the methods: power series of their steps, and the phase errors that follow."""
