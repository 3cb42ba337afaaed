"""The results window: boxes of whom one asks for, what the data say, and an export that is whole or not there."""

import os
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import fake_client
import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLabel

from app.ipc import messages as m
from app.ipc.process import start_python
from app.window.export import DIED, Job, export_results
from app.window.painting import theme
from app.window.painting.labels import OneLine
from app.window.results_window import POOLED, ResultsWindow
from core.files import InputError
from experiments.analysis.findings import FAILS
from experiments.analysis.trials_table import TrialRow, read_table, write_table


def results_of(participant: str, seed: int) -> list[TrialRow]:
    """A participant's sixty trials, with scores that depend on the controller and a little on chance."""
    generator = np.random.default_rng(seed)
    return [
        replace(
            fake_client.result(trial, error=1e-3 * trial.controller + 1e-4 * generator.random()),
            participant=participant,
            mean_tip_force_N=trial.controller + generator.random(),
            acceleration_dft_sum=30.0 * trial.controller + generator.random(),
        )
        for trial in fake_client.PLAN
    ]


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for i, participant in enumerate(("01", "02")):
        folder = tmp_path / f"sub-{participant}" / "ses-01"
        folder.mkdir(parents=True)
        write_table(folder / "trials.csv", results_of(participant, i))
    return tmp_path


def window_on(qtbot, data: Path, snapshot: m.Snapshot | None = None) -> ResultsWindow:
    theme.dress(QApplication.instance())
    opened = fake_client.opened("01", folder=str(data / "sub-01" / "ses-01"))
    window = ResultsWindow(opened, snapshot or fake_client.ready(60))
    qtbot.addWidget(window)
    window.show()
    return window


def test_boxes_hold_the_trials_of_whom_is_chosen(qtbot, data: Path) -> None:
    window = window_on(qtbot, data)
    assert [window.whose.itemText(i) for i in range(window.whose.count())] == [POOLED, "01", "02"]
    pooled = window.boxes[0].found[(2, "three-brake")]
    assert pooled.count == 12 and "12 trials a box" in window.boxes[0].said
    window.whose.setCurrentText("02")
    own = window.boxes[0].found[(2, "three-brake")]
    mine = [row for row in results_of("02", 1) if (row.controller, row.configuration) == (2, "three-brake")]
    wanted = [1e3 * row.path_error_m for row in mine]
    assert own.count == 6 and own.median == pytest.approx(np.median(wanted))
    assert "1 participant · 60 trials" in window.summary.text() and "One person is too few" in window.said.text()


def test_a_trial_more_is_a_trial_more_in_its_box(qtbot, data: Path) -> None:
    table = data / "sub-02" / "ses-01" / "trials.csv"
    rows = read_table(table)
    write_table(table, rows[:-1], replacing=True)
    window = window_on(qtbot, data, fake_client.ready(59))
    key = (rows[-1].controller, rows[-1].configuration)
    before = window.boxes[1].found[key].count
    picture = window.boxes[1].grab().toImage()
    write_table(table, rows, replacing=True)
    window.show_snapshot(fake_client.ready(60))
    assert window.boxes[1].found[key].count == before + 1 and len(window.boxes[1].points.points()) > 0
    assert window.boxes[1].grab().toImage() != picture


def test_redone_and_aborted_trials_are_in_no_box(qtbot, data: Path) -> None:
    table = data / "sub-01" / "ses-01" / "trials.csv"
    rows = read_table(table)
    rows[:2] = replace(rows[0], status="redone"), replace(rows[1], status="aborted")
    write_table(table, rows, replacing=True)
    window = window_on(qtbot, data)
    assert sum(box.count for box in window.boxes[0].found.values()) == 118 and "118 trials" in window.summary.text()


def test_the_statements_are_judged_on_what_is_shown(qtbot, data: Path) -> None:
    window = window_on(qtbot, data)
    assert len(window.verdicts.found) == 11 and window.verdicts.isVisible()
    by_number = {finding.statement.number: finding.verdict for finding in window.verdicts.found}
    assert by_number[1] == FAILS  # "SDOF reduces path error": here it is larger than without control


def test_codes_of_a_blind_session_stand_as_codes_and_nothing_is_claimed(qtbot, data: Path) -> None:
    window = window_on(qtbot, data)
    for participant in ("01", "02"):
        table = data / f"sub-{participant}" / "ses-01" / "trials.csv"
        write_table(table, [replace(row, controller=f"K{row.controller}") for row in read_table(table)], replacing=True)
    window.refresh()
    assert window.boxes[0].controllers == ("K1", "K2", "K3", "K4", "K5")
    assert "blind" in window.said.text() and not window.verdicts.isVisible() and window.verdicts.found == []


def test_the_papers_statements_are_not_judged_on_other_controllers(qtbot, data: Path) -> None:
    theme.dress(QApplication.instance())
    ours = fake_client.opened("01", folder=str(data / "sub-01" / "ses-01"))
    other = {1: ours.controllers[1], 2: ours.controllers[4]._replace(name="Softly")}
    window = ResultsWindow(ours._replace(controllers=other), fake_client.ready(60))
    qtbot.addWidget(window)
    window.show()
    assert "Table I" in window.said.text() and not window.verdicts.isVisible()


def test_a_damaged_table_is_said_and_the_session_is_still_shown(qtbot, data: Path) -> None:
    (data / "sub-02" / "ses-01" / "trials.csv").write_text("nonsense")
    window = window_on(qtbot, data, fake_client.ready(20))
    assert sum(box.count for box in window.boxes[0].found.values()) == 20
    assert "trials.csv" in window.said.text()


def test_an_export_is_whole_and_in_a_new_folder(qtbot, data: Path) -> None:
    (data / "results-1").mkdir()
    window = window_on(qtbot, data)
    QTest.mouseClick(window.export_button, Qt.MouseButton.LeftButton)
    assert window.cancel_button.isVisible() and not window.export_button.isEnabled()
    qtbot.waitUntil(lambda: "results-2" in window.said.text(), timeout=60_000)
    folder = data / "results-2"
    assert {path.suffix for path in folder.iterdir()} == {".png", ".svg", ".pdf", ".csv"}
    exported = read_table(folder / "trials.csv")
    assert len(exported) == 120 and not window.cancel_button.isVisible() and window.export_button.isEnabled()
    assert (folder / exported[0].recording).resolve() == data / "sub-01" / "ses-01" / "trials" / "run-001.parquet"


class Held:
    """What a process says; after its first line it waits, for a machine may hold us up for longer than it takes."""

    def __init__(self, process: subprocess.Popen) -> None:
        self._process, self._lines = process, process.stdout
        process.stdout = self  # type: ignore[assignment]

    def __iter__(self) -> Iterator[bytes]:
        for number, line in enumerate(self._lines):
            if number == 0:
                self._process.send_signal(signal.SIGSTOP)
            yield line

    def close(self) -> None:
        self._lines.close()


def begun(qtbot, window: ResultsWindow, monkeypatch: pytest.MonkeyPatch) -> subprocess.Popen:
    """The process of an export that has begun, and waits."""

    def start(*arguments: str, **how: object) -> subprocess.Popen:
        process = start_python(*arguments, **how)
        Held(process)
        return process

    monkeypatch.setattr("app.window.export.start_python", start)
    with qtbot.waitSignal(window._export.progressed, timeout=60_000):
        window.export()
    return window._export._process


def test_a_cancelled_export_leaves_nothing(qtbot, data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    window = window_on(qtbot, data)
    before = sorted(data.iterdir())
    process = begun(qtbot, window, monkeypatch)
    QTest.mouseClick(window.cancel_button, Qt.MouseButton.LeftButton)
    process.send_signal(signal.SIGCONT)
    qtbot.waitUntil(lambda: "cancelled" in window.said.text(), timeout=60_000)
    assert sorted(data.iterdir()) == before and not window.cancel_button.isVisible()


def test_a_window_that_closes_ends_its_export(qtbot, data: Path) -> None:
    window = window_on(qtbot, data)
    before = sorted(data.iterdir())
    window.export()
    window.close()
    assert not window._export.busy and sorted(data.iterdir()) == before
    assert window._export._process.poll() is not None


def test_an_export_that_dies_is_said_and_leaves_nothing(
    qtbot, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    window = window_on(qtbot, data)
    before = sorted(data.iterdir())
    begun(qtbot, window, monkeypatch).kill()
    qtbot.waitUntil(lambda: window.said.text() == DIED, timeout=60_000)
    assert sorted(data.iterdir()) == before


def test_an_export_never_writes_over_anything(data: Path) -> None:
    rows, folder = results_of("01", 1), data / "mine"
    folder.mkdir()
    with pytest.raises(InputError, match="exists already"):
        export_results(Job(tuple(rows), data, folder, "note", ("three-brake",), {}))
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(("width", "height"), ((1280, 720), (1920, 1080)))
def test_no_text_is_cut(qtbot, data: Path, width: int, height: int) -> None:
    window = window_on(qtbot, data)
    window.resize(width, height)
    QApplication.processEvents()
    assert (window.width(), window.height()) == (width, height)
    for label in window.findChildren(QLabel):
        if label.isVisible() and not isinstance(label, OneLine):
            assert label.width() >= label.sizeHint().width(), label.text()
    assert window.export_button.width() >= window.export_button.sizeHint().width()
