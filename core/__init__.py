"""The device, its brakes and its controllers, simulated; the files that describe them."""
