"""Files of one's own beside a protocol: a small controller, the shipped example of measures, and their protocol."""

import json
from pathlib import Path

from core.control.own_file import read_own
from core.own_consent import allow
from core.own_files import OwnFile
from experiments.own_measure import declared_measures
from experiments.store.database import Database
from experiments.store.stored import put_file

ROOT = Path(__file__).resolve().parents[2]
MEASURE = (ROOT / "docs/examples/protocols/my_measure.py").read_text(encoding="utf-8")
DAMPER = '''\
"""A controller of one's own: a damper that brakes whatever moves off the path.

Simpler than the shipped one: the sense of a joint that hardly turns is that of the noise, and each tick begins anew, so
currents tremble as the velocity does.
"""

from core.control.algorithm import GAP_M, NONE, OWN, Algorithm, Parameter, actuate
from core.kernels import kernel

DAMPING = Parameter("damping_N_s_m", "damping", "N s/m", 1.0, 200.0, (10.0, 2000.0))
DAMPED = OWN  # its own decision


@kernel
def decide(controller, field, tick):
    """Asks the brake that opposes the motion off the path most for a force of damping times that speed."""
    damping, seen = controller.values[1], tick.seen
    off_path = seen.vx * field.n_x + seen.vy * field.n_y  # m/s, towards the path; negative away from it
    best, most = -1, 0.0
    for i in range(4):
        g_x, g_y = tick.g[i, 0], tick.g[i, 1]  # 1/m, of joint i: a brake there pulls along -sign(g . v) g
        turning = g_x * seen.vx + g_y * seen.vy
        sense = 1.0 if turning > 0.0 else -1.0
        against = sense * (g_x * field.n_x + g_y * field.n_y) * (1.0 if off_path > 0.0 else -1.0)
        if tick.brakes.present[i] != 0.0 and against > most:
            best, most = i, against
    if best < 0:
        return NONE
    actuate(tick, best, damping * abs(off_path))
    return DAMPED


ALGORITHM = Algorithm("my_damper", (GAP_M, DAMPING), ("damped",), decide)
'''
PROTOCOL = """
name = "dampers"
provenance = "assumed"
devices = ["three-brake"]
blocks = 1
[[path]]
kind = "segment"
start_m = [-0.05, 0.40]
end_m = [0.05, 0.40]
[[controller]]
name = "Damper"
algorithm = "my_damper.py"
parameters = {damping_N_s_m = 500.0}
"""
FREE = """
[[controller]]
name = "Free"
kind = "none"
"""


def own_experiment(folder: Path, text: str = PROTOCOL + FREE, **files: str) -> Path:
    """A protocol in a folder, with the files that it names; files: others, or other texts, by name without .py."""
    for name, code in {"my_damper": DAMPER, "my_measure": MEASURE, **files}.items():
        (folder / f"{name}.py").write_text(code, encoding="utf-8")
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    return folder / "mine.toml"


def controller_of(name: str, text: str) -> OwnFile:
    """A controller that may run."""
    allow(text)
    return read_own(name, text)


def measures_of(name: str, text: str) -> OwnFile:
    """A file of measures that may run."""
    allow(text)
    return OwnFile(name, text, json.dumps(declared_measures(name, text)))


def put_code(session: Path, about: str) -> None:
    """Put code that nobody has allowed into a session's folder. about: it is other code than that of other tests."""
    with Database(session, sync=False) as database:
        put_file(database, "code/odd.py", f"# {about}")
