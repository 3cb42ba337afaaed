"""The windows: participant, console, results."""
