"""The device on the bench: is it ready, what its board and sensors report, and how a new one is brought up."""
