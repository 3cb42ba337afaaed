"""One session on disk: plan, journal, verification, recovery."""
