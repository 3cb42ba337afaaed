"""Speed against error of the integrators."""
