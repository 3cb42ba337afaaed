"""The verbs of the command line, in light modules: what a verb needs is imported when it runs."""
