"""From raw counts and readings to position, velocity and force in SI units."""
