"""The verbs of the command line, one light module each: what a verb needs is imported when it runs."""
