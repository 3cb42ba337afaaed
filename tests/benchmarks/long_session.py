"""The paper's session of 60 trials in real time, by a simulated operator, through the real windows; a script:

    xvfb-run -a -s "-screen 0 1920x1080x24" python tests/benchmarks/long_session.py [--kill window|loop] [--hogs N] ..

It prints what was recorded and how late the ticks were, as JSON.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

from app.ipc.messages import Setup  # noqa: E402

EVERY = 10  # trials
MOVING_S = 2.5  # after the start of a trial


def drive(setup: Setup, most: int) -> None:
    """The window's process: press the space bar whenever there is something to go on with, until the plan is done, or
    so many trials.
    """
    from PySide6.QtCore import Qt, QTimer
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QApplication

    from app.ipc import messages as m
    from app.ipc.client import Client
    from app.window.painting import theme
    from app.window.windows import Windows

    application = QApplication([])
    theme.dress(application)
    windows = Windows(Client(setup))
    windows.show()
    windows.show_or_hide_participant()
    told, asked = set(), False
    running = m.Snapshot(m.PREPARING)

    def go_on() -> None:
        nonlocal running, asked
        now = windows.main.snapshot
        if now.running and now.running != running:
            print("run", now.running.run, flush=True)
        running = now.running
        if now.stage == m.NO_SESSION and not now.why_not and not asked:
            asked = True
            windows.client.send(m.Open("01", resume=(setup.data_dir / "sub-01").exists()))
        elif now.stage in (m.READY, m.RERIG) and sum(row.status != "recovered" for row in now.rows) < most:
            QTest.keyClick(windows.participant, Qt.Key.Key_Space)
        elif now.stage in (m.READY, m.RERIG, m.FINISHED, m.FAILED) and now.stage not in told:
            told.add(now.stage)
            print(now.stage, now.said, flush=True)
            windows.close()
            application.quit()

    timer = QTimer()
    timer.timeout.connect(go_on)
    timer.start(200)
    application.exec()


def start_window(setup: Setup, most: int) -> subprocess.Popen:
    """A window in a process of its own."""
    command = [sys.executable, __file__, "--drive", setup.to_json(), "--trials", str(most)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)


def session(data: Path, args: argparse.Namespace) -> dict:
    """Run it, kill as asked, and look at what there is."""
    from live import wait_until
    from processes import children, gone

    victim, setup = args.kill, Setup(data, hand="operator", seed=1, real_time=not args.default)
    window, kills, began = start_window(setup, args.trials), 0, time.perf_counter()
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
            server = children(window.pid)[0]
            if victim == "window":
                window.send_signal(signal.SIGKILL)
                window.wait()
                wait_until(lambda server=server: gone(server))  # it finishes its trial
                window = start_window(setup, args.trials)
            else:
                os.kill(children(server)[0], signal.SIGKILL)
    wall_s = round(time.perf_counter() - began, 1)
    return {"killed": victim, "kills": kills, "hogs": args.hogs, "wall_s": wall_s, **recorded(data)}


def recorded(data: Path) -> dict:
    """What a session left: rows by status, and the lateness of all ticks of its finished trials."""
    from collections import Counter

    import numpy as np

    from experiments.recording.reader import read_recording
    from experiments.session.files import cell, read_stored, rows_of, session_folder
    from experiments.session.verify import verify

    folder = session_folder(data, "01")
    rows, plan = rows_of(folder), read_stored(folder).plan
    kept = {row.run: read_recording(folder / row.recording) for row in rows}
    done = [row for row in rows if row.status == "done"]
    late = np.concatenate([kept[row.run].column("lateness_us") for row in done])
    worst = max(done, key=lambda row: kept[row.run].column("lateness_us").max())
    return {
        "rows": dict(Counter(row.status for row in rows)),
        "reasons": {row.run: kept[row.run].outcome["reason"] for row in rows if row.status in ("aborted", "timeout")},
        "every cell done once": sorted(map(cell, done)) == sorted(map(cell, plan)),
        "recordings": len(kept),
        "whole": sum(one.whole for one in kept.values()),
        "faults": verify(data)["faults"],
        "lost_ticks": sum(kept[row.run].outcome["timing"]["lost"] for row in done),
        "ticks": len(late),
        "late_200_us": int(np.count_nonzero(late >= 200.0)),
        "missed_1_ms": int(np.count_nonzero(late >= 1000.0)),
        "stolen_ms": sum(kept[row.run].outcome["timing"]["stolen_ms"] or 0.0 for row in done),
        **{f"p{p:g}_us": round(float(np.percentile(late, p)), 1) for p in (50, 99, 99.9)},
        "max_us": round(float(late.max()), 1),
        "worst_run": worst.run,
        "scheduling": kept[done[0].run].outcome["timing"]["scheduling"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kill", choices=("window", "loop"), help="kill -9 in every tenth trial")
    parser.add_argument("--trials", type=int, default=60, help="end after so many (default: all)")
    parser.add_argument("--hogs", type=int, default=0, help="processes beside it that do nothing but compute")
    parser.add_argument("--default", action="store_true", help="no scheduling that needs a privilege")
    parser.add_argument("--drive", metavar="SETUP", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.drive:
        drive(Setup.from_json(args.drive), args.trials)
        return
    from app.verbs.loop_lateness import hogs

    with tempfile.TemporaryDirectory() as folder, hogs(args.hogs):
        print(json.dumps(session(Path(folder) / "data", args), indent=1))


if __name__ == "__main__":
    main()
