"""The Run page: a session, as its experimenter sees it."""
