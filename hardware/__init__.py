"""The device on the bench: boards on a serial port, six-axis input devices. Imports core only."""
