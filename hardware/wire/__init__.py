"""The board's protocol: frames and messages. No port, no clock."""
