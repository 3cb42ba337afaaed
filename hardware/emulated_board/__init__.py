"""A board for tests and for trying out: the simulator behind the wire protocol."""
