"""What the set-up compiles: everything that the first study, simulation and live trial need."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

from protocols import short

from app.compile_kernels import compiled
from app.progress import watch_compiling
from core.kernels.cache import LINKING, watchers

SCENE = Path(__file__).parents[2] / "experiments" / "scenes" / "locked-brake.toml"
COUNTED = """
import sys
from numba.core.event import Listener, register
names = []
class Count(Listener):
    def on_start(self, event): names.append(event.data["dispatcher"].__name__)
    def on_end(self, event): pass
register("numba:compile", Count())
{code}
print(*names)
"""


def run_python(*arguments: str, **more: str) -> str:
    """What a new process prints that compiles. more: of its environment."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "0", **more}
    done = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr
    return done.stdout


#: the window's part
DRAWING = """
from app.window.canvas.layers import Instant, directions, field_at_rest, needles
from core.device import load_device
from core.path import Segment, build_path, outline
device, segment = load_device("three-brake"), Segment((-0.1, 0.4), (0.1, 0.4))
path = build_path(segment, "path")
assert len(outline(segment, 0.01)) and len(needles(path, 1.0, device, (0, 0.3), (0.1, 0.5), 0.02))
instant = Instant(device, (0.0, 0.38))
assert directions(device, instant.g, field_at_rest(path, instant.tip, 1.0))
"""

#: as the window asks before it compiles
IS_COMPILED = 'from core.kernels.cache import is_compiled\nprint(is_compiled("run_trial"))'


def compiled_by(code: str, **environment: str) -> str:
    """The kernels that a new process compiles that runs this code."""
    return run_python("-c", COUNTED.format(code=code), **environment).splitlines()[-1]


def test_after_the_set_up_a_study_and_a_simulation_compile_nothing_and_later_no_live_trial(tmp_path) -> None:
    kept = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    said = run_python("-m", "app.compile_kernels", "--no-window", **kept)
    assert said == "kernels: compiled\n"  # a bar, or lines in its place, are on stderr
    (tmp_path / "short.toml").write_text(short(paths=1).text)
    study = ["study", str(tmp_path / "short.toml"), "--operators", "1", "--out", str(tmp_path / "study")]
    scene = ["simulate", str(SCENE), "--out", str(tmp_path / "rows.csv")]
    verbs = f"from app.cli import main\nassert main({study}) == main({scene}) == 0\n"
    assert compiled_by(verbs, **kept) == ""
    assert run_python("-c", IS_COMPILED, **kept) == "False\n"
    assert run_python("-m", "app.compile_kernels", **kept) == "kernels: compiled\n"
    assert run_python("-c", IS_COMPILED, **kept) == "True\n"
    assert compiled_by("from app.loop.loop import run_stopped_trial\nrun_stopped_trial()" + DRAWING, **kept) == ""


def test_what_cannot_be_compiled_is_one_sentence(capsys) -> None:
    def compile_trials() -> None:
        raise TypeError("no such number")

    assert compiled(compile_trials) == 1
    assert capsys.readouterr().err == "phd: compile_trials: TypeError: no such number\n"


def test_on_a_terminal_a_bar_says_which_of_how_many_kernels(monkeypatch, capsys) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    clock = SimpleNamespace(perf_counter=iter((0.0, 1.0, 1.5, 2.0, 3.0, 3.5)).__next__)
    monkeypatch.setattr("app.progress.time", clock)
    compiling = watch_compiling()
    try:
        watchers[0](3, 6, "drag")
        assert f"[{'.' * 30}] 3 of 6" in capsys.readouterr().err  # the bar of few would go back for the many
        watchers[0](45, 156, "advance_event")
        assert "45 of 156" in capsys.readouterr().err
        watchers[0](156, 156, LINKING)
        assert "[###############...............] linking" in capsys.readouterr().err
        watchers[0](0, 0, "")
        assert capsys.readouterr().err == "\r\033[K" and compiling.seconds == 2.5
    finally:
        watchers.clear()
