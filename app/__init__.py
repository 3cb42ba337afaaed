"""The application: the command line `phd` and its window. Qt is imported by the window alone."""

__version__ = "0.1.0"
