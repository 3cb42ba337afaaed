"""The application: the command line `phd` and its window. Qt is imported by the window alone."""

import os
from pathlib import Path

# before numpy is imported: its sums over long trials (over 10,000 ticks) have other last digits with other threads
os.environ["OPENBLAS_NUM_THREADS"] = "1"

__version__ = "0.1.0"
DATA = Path.home() / "phd-data"  # of sessions, unless another is chosen; outside the folder of the program
