"""An experimenter's session through the real window: a timeout, an exclusion, a repeated trial, a translation, and the
report at the end.
"""

import re
from functools import partial
from pathlib import Path

import waiting
from protocols import PAPER
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QWidget

from app.ipc import messages as m
from app.ipc.client import Client
from app.ipc.messages import Setup
from app.window.widgets.page import ANALYSE, RUN
from app.window.windows import Windows
from experiments.inputs import OPERATOR
from experiments.store.verify import verify
from tests.support.rows import read_rows

wait_until = partial(waiting.wait_until, pause=lambda: QTest.qWait(10))

LEFT = Qt.MouseButton.LeftButton


def protocol_file(folder: Path) -> Path:
    """Two controllers, one path, one device, in German. This operator takes 1.9 s without control, 2.7 s with SDOF."""
    text = re.sub(r"(?s)\[\[controller\]\].*?(?=\n\[trial\])", "", PAPER.text)
    text = re.sub(r"(?s)\[\[path\]\]\nnumber = 2.*?\n\n", "", text)
    for key, value in (("devices", '["three-brake"]'), ("blocks", "1"), ("time_out_s", "2.3"), ("name", '"two"')):
        text = re.sub(rf"(?m)^{key} = .*", f"{key} = {value}", text)
    controllers = '[[controller]]\nname = "None"\nkind = "none"\n[[controller]]\nname = "SDOF"\nkind = "sdof"\n'
    path = folder / "two.toml"
    path.write_text(f'language = "de"\n{text}\n{controllers}', encoding="utf-8")
    return path


def space(main: QWidget) -> None:
    """Press the space bar in the main window."""
    main.activateWindow()
    QTest.qWaitForWindowActive(main)
    QTest.keyClick(main, Qt.Key.Key_Space)


def run_trial(windows: Windows) -> None:
    """Space until the next trial runs, and wait for its card."""
    main, run = windows.main, windows.main.page(RUN)
    before = len(main.snapshot.rows)
    wait_until(lambda: (not run.card_shown or run.card.ready) and not main.snapshot.trial_blocker)
    space(main)
    wait_until(lambda: len(main.snapshot.rows) > before and run.card_shown)


def test_a_whole_session_of_an_experimenter(qtbot, tmp_path: Path) -> None:
    setup = Setup(tmp_path / "data", str(protocol_file(tmp_path)), hand=OPERATOR, sync=False)
    windows = Windows(Client(setup))
    main, run = windows.main, windows.main.page(RUN)
    windows.show()
    wait_until(lambda: main.snapshot.stage == m.NO_SESSION and not main.snapshot.trial_blocker)
    main.send(m.Open("01"))
    wait_until(lambda: main.snapshot.stage == m.READY and main.shown == RUN)
    assert len(main.opened.plan) == 2 and "Willkommen" in run.workspace.view.line
    run_trial(windows)
    first = main.snapshot.rows[-1]
    QTest.mouseClick(run.card.exclude, LEFT)
    QTest.keyClick(run.cards.question.own, Qt.Key.Key_1, Qt.KeyboardModifier.AltModifier)
    wait_until(lambda: main.snapshot.rows[-1].status == "excluded" and not run.card_shown)
    run_trial(windows)
    second = main.snapshot.rows[-1]
    QTest.mouseClick(run.card.redo, LEFT)
    QTest.keyClick(run.cards.question.own, Qt.Key.Key_1, Qt.KeyboardModifier.AltModifier)
    wait_until(lambda: main.snapshot.rows[-1].status == "redone" and not run.card_shown)
    run_trial(windows)
    assert main.snapshot.stage == m.FINISHED
    rows = read_rows(Path(main.opened.folder) / "trials.csv")
    assert [(row.run, row.status) for row in rows[:2]] == [(first.run, "excluded"), (second.run, "redone")]
    assert (rows[2].controller, rows[2].status) == (2, "timeout")

    main.show_page(ANALYSE)
    page = main.page(ANALYSE)
    wait_until(lambda: page.trials is not None and len(page.trials))
    page.export(report=True)
    wait_until(lambda: list((setup.data_dir / "results-1").glob("*.pdf")))
    windows.close()
    assert verify(setup.data_dir)["faults"] == []
