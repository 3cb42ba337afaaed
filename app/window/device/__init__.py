"""The device on the bench: is it ready, and what its board and sensors report."""
