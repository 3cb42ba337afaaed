# What type checkers read of phd.py: a module that is one file cannot say that it is typed.
from app.frames import boxes, load_recording, load_trials, replay, run_scene, run_study, statistics
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
