"""The simulated device: state, exact stick and slip, integrators. No clock, no files."""
