"""Export of the results so far into a new folder: the box plots as PNG, SVG and PDF, the trials as CSV."""

import os
import threading
from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from core.errors import InputError
from experiments.boxplots import draw_boxplots
from experiments.trials_table import TrialRow, write_table


def export_results(rows: Sequence[TrialRow], session: Path, folder: Path, note: str, devices: Sequence[str]) -> int:
    """Write figures and trials.csv into `folder`, new or empty; how many files. InputError says why not.

    session: where the rows' recordings are relative to.
    """
    try:
        if folder.exists() and any(folder.iterdir()):
            raise InputError(f"{folder}: is not empty, the results need a new folder")
    except OSError as error:
        raise InputError(f"{folder}: cannot be used ({(error.strerror or str(error)).lower()})") from None
    here = Path(os.path.relpath(session, folder)).as_posix()
    figures = draw_boxplots(rows, folder, note, devices)
    write_table(folder / "trials.csv", [row.seen_from(here) for row in rows])
    return len(figures) + 1


class Export(QObject):
    """One export at a time, in a thread beside the window (drawing for print takes seconds)."""

    finished = Signal(str)  # what was written, in a sentence
    refused = Signal(str)  # why nothing was

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._thread: threading.Thread | None = None

    @property
    def busy(self) -> bool:
        """Whether one is running."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, rows: Sequence[TrialRow], session: Path, folder: Path, note: str, devices: Sequence[str]) -> None:
        """Begin to write; a signal tells the end."""
        job = (tuple(rows), session, folder, note, tuple(devices))
        self._thread = threading.Thread(target=self._work, args=job, name="export")
        self._thread.start()

    def wait(self) -> None:
        """Until what runs is written."""
        if self._thread is not None:
            self._thread.join()

    def _work(self, rows, session: Path, folder: Path, note: str, devices) -> None:
        try:
            count = export_results(rows, session, folder, note, devices)
        except (InputError, OSError) as error:
            self.refused.emit(str(error))
        else:
            self.finished.emit(f"{count} files written to {folder}")
