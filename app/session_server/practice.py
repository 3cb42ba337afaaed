"""Practice without a session: on a simulated device of its own, or on the one that stands ready on the bench."""

import threading

import numpy as np

from app.ipc.messages import OPERATOR, Setup
from core.device import Device
from core.path import build_path
from core.simulator.simulated_device import SimulatedDevice
from experiments.plan import PlannedTrial, participant_index
from experiments.protocol import Protocol
from experiments.trial.operator import Person
from experiments.trial.population import load_population
from experiments.trial.trial import Trial


class Practice:
    """One trial after another, outside of any session."""

    def __init__(self, setup: Setup, protocol: Protocol) -> None:
        """Build the simulated device, whose kernels may have to be compiled, beside everything else."""
        self._setup, self._protocol = setup, protocol
        self.simulation: SimulatedDevice | None = None  # None: not built yet
        self.tried = 0
        self.failure: BaseException | None = None
        self.loop_ready = threading.Event()  # set once it is: the loop needs the processors more
        threading.Thread(target=self._prepare, name="preparation", daemon=True).start()

    def _prepare(self) -> None:
        protocol = self._protocol
        try:
            path = build_path(next(iter(protocol.paths.values())), "path")
            hand = None if self._setup.hand == OPERATOR else protocol.mouse.hand()
            self.simulation = SimulatedDevice(protocol.devices[0], (path.x1, path.y1), hand)  # there is a way to go
            self.loop_ready.wait()
            import scipy.fft
            import scipy.signal  # noqa: F401  (the measures need them: seconds, but not after the first trial)
        except BaseException as error:
            self.failure = error  # raised again in `State.watch`, where it ends the server

    def trial(self, device: SimulatedDevice | Device) -> Trial:
        """The next one, on the simulated device or on a real one.

        Our choice: it goes through the controllers, those that brake first, and through the paths.
        """
        p, turn = self._protocol, self.tried
        self.tried += 1
        controllers = sorted(p.controllers, key=lambda number: p.controllers[number].kind == "none")
        controller, segment = controllers[turn % len(controllers)], list(p.paths)[turn % len(p.paths)]
        file = device if isinstance(device, Device) else device.device
        planned = PlannedTrial(0, 0, file.name, controller, segment, self.tried)
        path, preset = p.paths[segment], p.controllers[controller]
        person = person_at(self._setup, p, "0")
        return Trial(device, planned, path, preset, p.rules, p.trial, person, np.random.default_rng(turn))


def done_without(setup: Setup, protocol: Protocol) -> str:
    """What the protocol asks for and a simulated operator's sessions have not, as a sentence; "": nothing is amiss."""
    asked = {
        "no blinding": protocol.blind, "no practice": protocol.practice_trials > 0,
        "no questionnaire": protocol.questionnaire.on,
    }  # fmt: skip
    missing = [what for what, is_asked in asked.items() if is_asked]
    if setup.hand != OPERATOR or not missing:
        return ""
    return f"A simulated operator moves the handle: {' and '.join(missing)}, whatever the protocol says."


def person_at(setup: Setup, protocol: Protocol, participant: str) -> Person | None:
    """The simulated operator that has this participant's place, if one moves the handle."""
    if setup.hand != OPERATOR:
        return None
    seeds = np.random.SeedSequence([protocol.seed, participant_index(participant)])
    return load_population().draw(np.random.default_rng(seeds))
