"""The paper's session of 60 trials in real time, by a simulated operator, through the real console; a script:

    xvfb-run -a python tests/long_session.py [window|loop] [OUT]

window, loop: kill -9 of that process in the middle of every tenth trial; the window is then started again. It prints
what was recorded and how late the ticks were, as JSON. OUT: a new folder for the data, else none is kept.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

from app.live.setup import Setup

EVERY = 10  # trials
MOVING_S = 2.5  # after the start of a trial


def drive(setup: Setup) -> None:
    """The window's process: press the space bar whenever there is something to go on with, until the plan is done."""
    from PySide6.QtCore import Qt, QTimer
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QApplication

    from app.live import messages as m
    from app.live.bench import Bench
    from app.screens import theme
    from app.screens.windows import Windows

    application = QApplication([])
    theme.dress(application)
    windows = Windows(Bench(setup))
    windows.show()
    windows.show_or_hide_participant()
    console, told = windows.console, set()
    running = m.Snapshot(m.PREPARING)

    def go_on() -> None:
        nonlocal running
        now = console.snapshot
        if now.running and now.running != running:
            print("run", now.running.run, flush=True)
        running = now.running
        if now.stage == m.NO_SESSION and console.start_page.new.isEnabled():
            QTest.keyClick(console.start_page.participant, Qt.Key.Key_Return)
        elif now.stage in (m.READY, m.RERIG):
            QTest.keyClick(windows.participant, Qt.Key.Key_Space)
        elif now.stage in (m.FINISHED, m.FAILED) and now.stage not in told:
            told.add(now.stage)
            print(now.stage, now.said, flush=True)
            windows.close()
            application.quit()

    timer = QTimer()
    timer.timeout.connect(go_on)
    timer.start(200)
    application.exec()


def start_window(setup: Setup) -> subprocess.Popen:
    """A window in a process of its own."""
    command = [sys.executable, __file__, "drive", setup.to_json()]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)


def session(data: Path, victim: str) -> dict:
    """Run it, kill as asked, and look at what there is."""
    from live import children

    from app.live.place import find

    setup = Setup(data, hand="operator", seed=1)
    window, kills, began = start_window(setup), 0, time.monotonic()
    trials = 0
    while True:
        line = window.stdout.readline()
        if not line:
            assert window.wait() == 0, "the window failed"
            break
        if not line.startswith("run"):
            print(line, file=sys.stderr, end="", flush=True)
            continue
        trials += 1
        print(f"\r{line.strip()}  ", file=sys.stderr, end="", flush=True)
        if victim and trials % EVERY == 0:
            time.sleep(MOVING_S)
            kills += 1
            if victim == "window":
                window.send_signal(signal.SIGKILL)
                window.wait()
                window = start_window(setup)
            else:
                os.kill(children(find(data).pid)[0], signal.SIGKILL)
    return {"victim": victim, "kills": kills, "wall_s": round(time.monotonic() - began, 1), **recorded(data)}


def recorded(data: Path) -> dict:
    """What a session left: rows by status, and the lateness of all ticks of its finished trials."""
    from collections import Counter

    import numpy as np

    from experiments.recording import read_recording
    from experiments.session_files import cell, read_stored, rows_of, session_folder
    from experiments.verify import verify

    folder = session_folder(data, "01")
    rows, plan = rows_of(folder), read_stored(folder).plan
    kept = {row.run: read_recording(folder / row.recording) for row in rows}
    done = [row for row in rows if row.status == "done"]
    late = np.concatenate([kept[row.run].column("lateness_us") for row in done])
    worst = max(done, key=lambda row: kept[row.run].column("lateness_us").max())
    return {
        "rows": dict(Counter(row.status for row in rows)),
        "every cell done once": sorted(map(cell, done)) == sorted(map(cell, plan)),
        "recordings": len(kept),
        "whole": sum(one.whole for one in kept.values()),
        "faults": verify(data)["faults"],
        "lost_ticks": sum(kept[row.run].outcome["timing"]["lost"] for row in done),
        "ticks": len(late),
        "late_200_us": int(np.count_nonzero(late >= 200.0)),
        "missed_1_ms": int(np.count_nonzero(late >= 1000.0)),
        **{f"p{p:g}_us": round(float(np.percentile(late, p)), 1) for p in (50, 99, 99.9)},
        "max_us": round(float(late.max()), 1),
        "worst_run": worst.run,
        "scheduling": kept[done[0].run].outcome["timing"]["scheduling"],
    }


if __name__ == "__main__":
    if sys.argv[1:2] == ["drive"]:
        drive(Setup.from_json(sys.argv[2]))
    else:
        chosen = next((word for word in sys.argv[1:] if word in ("window", "loop")), "")
        out = next((word for word in sys.argv[1:] if word not in ("window", "loop")), "")
        with tempfile.TemporaryDirectory() as folder:
            print(json.dumps(session(Path(out or folder).absolute() / "data", chosen), indent=1))
