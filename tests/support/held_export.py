"""The process of an export that has begun to write and never comes to its end: it waits to be ended."""

import time

from app.window.analyse.export import main as export
from experiments.export import results_files


def main() -> None:
    """As `app.window.analyse.export`, held at its first figure."""
    results_files.draw_charts = lambda *_: time.sleep(600.0)
    export()
