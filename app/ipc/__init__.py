"""What loop, session server and window share: messages, the ring, the client. Imports none of the three."""
