"""The application: the command line `phd` and its window. Qt is imported by the window alone."""

import os
from pathlib import Path

# before numpy is imported: nothing here needs OpenBLAS' threads, and the loop is to have none beside it
os.environ["OPENBLAS_NUM_THREADS"] = "1"

__version__ = "0.1.0"
#: Of sessions, unless another is chosen; outside the folder of the program. Not absolute: this user has no home.
DATA = Path(os.path.expanduser("~")) / "phd-data"
