"""PHD from Python: devices, scenes, studies and recordings as pandas frames.

    import phd

    trials = phd.run_study("paper", operators=3, seed=1)
    phd.boxes(trials, "path_error_m")

Every frame has the units of its columns in `frame.attrs["units"]`. Wrong input raises InputError, one sentence. Only a
Session writes files, and importing phd changes nothing in your process. Kernels compile on first use; stderr shows the
progress.
"""

from app.frames import boxes, load_recording, load_trials, replay, run_scene, run_study, statistics
from app.progress import watch_compiling
from app.scripted_session import HandTick, Session, SessionTrial, SimulatedPerson
from core.device import Device, load_device
from core.device_from_values import device
from core.files import InputError
from core.simulator.stepped import Simulation, State
from experiments.protocol_writer import protocol

__all__ = [
    "Device", "HandTick", "InputError", "Session", "SessionTrial", "SimulatedPerson", "Simulation", "State", "boxes",
    "device", "load_device", "load_recording", "load_trials", "protocol", "replay", "run_scene", "run_study",
    "statistics",
]  # fmt: skip

watch_compiling()
