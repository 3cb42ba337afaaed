"""What the set-up compiles: everything that the first study, simulation, emulated board and live trial need."""

import ast
import os
import subprocess
import sys
from pathlib import Path

from protocols import short

from app.compile_kernels import compiled

SCENE = Path(__file__).parents[2] / "experiments" / "scenes" / "locked-brake.toml"
#: Prints in its last line what this process compiles, then what it looks for on disk (name and checksum of the types
#: of each entry): for the first part of its work, and for all of it.
WATCHED = """
import zlib
from numba.core.event import Listener, register
from core.kernels.compiler import EntryCache
new, asked, load = [], set(), EntryCache.load_overload
class Count(Listener):
    def on_start(self, event): new.append(event.data["dispatcher"].__name__)
    def on_end(self, event): pass
def watched_load(cache, signature, target):
    if not cache.kind: asked.add(f"{{cache._name}} {{zlib.crc32(str(signature).encode())}}")
    return load(cache, signature, target)
EntryCache.load_overload = watched_load
register("numba:compile", Count())
{first}
before = set(asked)
{then}
print((new, before, asked))
"""
SET_UP = "from app.compile_kernels import *\nassert compiled(compile_trials, compile_scene, compile_board) == 0\n"
#: the window's part of a live trial
LIVE = """
from app.loop.loop import run_stopped_trial
from app.window.canvas.layers import Instant, directions, field_at_rest, needles
from core.device import load_device
from core.path import Segment, build_path, outline
run_stopped_trial()
device, segment = load_device("three-brake"), Segment((-0.1, 0.4), (0.1, 0.4))
path = build_path(segment, "path")
assert len(outline(segment, 0.01)) and len(needles(path, 1.0, device, (0, 0.3), (0.1, 0.5), 0.02))
instant = Instant(device, (0.0, 0.38))
assert directions(device, instant.g, field_at_rest(path, instant.tip, 1.0))
"""
#: a handle that goes along a path of its own, in each hand
BOARD = """
import threading
from app.emulated_operator import drawn_operator
from core.device import load_device, shipped_devices
from core.path import Polyline, build_path
from hardware.emulated_board.device import HeldHand
from hardware.emulated_board.emulator import Emulator, EmulatorSettings
path = build_path(Polyline(((-0.05, 0.4), (0.0, 0.42), (0.05, 0.4))), "path")
for name in shipped_devices():
    for hand in (HeldHand((path.x0, path.y0)), drawn_operator(path, 1)):
        emulator = Emulator([load_device(name)], hand, (path.x0, path.y0), [], EmulatorSettings())
        threading.Timer(0.15, emulator.stop).start()
        emulator.run()
        emulator.close()
"""
#: figures and error bars take longest, and no kernel of their own
BRIEFLY = f"""
import sys
sys.path.insert(1, {str(Path(__file__).parents[1] / "support")!r})
import conclusions
from app.cli import main
"""
STEPPED = """
import phd
simulation = phd.Simulation("three-brake")
simulation.step([0.1, 0.0, 0.0], (1.0, 0.0))
simulation.state
"""


def watched(first: str, then: str) -> tuple[set[str], set[str], set[str]]:
    """What a new process compiles that runs this code, and the entries it asks for: by the first part, and both."""
    command = [sys.executable, "-c", WATCHED.format(first=first, then=then)]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "0"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr
    compiled, without_window, with_window = ast.literal_eval(done.stdout.splitlines()[-1])
    return set(compiled), without_window, with_window


def test_the_set_up_compiles_all_that_a_study_a_simulation_an_emulated_board_and_a_live_trial_need(tmp_path) -> None:
    """Whatever another test has compiled meanwhile: each entry that they ask for is one of the set-up's."""
    (tmp_path / "short.toml").write_text(short(paths=1, devices='["three-brake"]').text)
    study = ["study", str(tmp_path / "short.toml"), "--operators", "1", "--out", str(tmp_path / "study")]
    scene = ["simulate", str(SCENE), "--out", str(tmp_path / "rows.csv")]
    verbs = f"{BRIEFLY}with conclusions.left_out(): assert main({study}) == main({scene}) == 0\n"
    _, without_window, with_window = watched(SET_UP, "assert compiled(compile_loop) == 0")
    compiled, headless, live = watched(verbs + BOARD + STEPPED, LIVE)
    assert compiled == set()
    assert len(headless) > 10 and headless - without_window == set() and live - with_window == set()


def test_what_cannot_be_compiled_is_one_sentence(capsys) -> None:
    def compile_trials() -> None:
        raise TypeError("no such number")

    assert compiled(compile_trials) == 1
    assert capsys.readouterr().err == "phd: compile_trials: TypeError: no such number\n"
