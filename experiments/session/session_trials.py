"""The trials of a session, ready to be run: on its simulated devices, or on the one that stands on the bench."""

import numpy as np

from core.device import Device
from core.path import point_at
from core.path_file import build_path
from core.simulator.simulation import Simulation
from experiments.plan import PlannedTrial, participant_index
from experiments.session.session_order import SessionOrder
from experiments.trial.linked_trial import LinkedTrial
from experiments.trial.trial import Trial, new_simulation


class SessionTrials(SessionOrder):
    """A session's devices, and what is run on them."""

    devices: dict[str, Device]
    _simulations: dict[str, Simulation]

    def simulation(self, configuration: str) -> Simulation:
        """The simulated device of a configuration; it stays as the last trial left it."""
        if configuration not in self._simulations:
            number, path_file = next(iter(self.protocol.paths.items()))
            path = build_path(path_file, f"path {number}")
            x, y, _, _ = point_at(path, 0.5 * path.length)
            hand = None if self.person else self.protocol.mouse.hand()
            self._simulations[configuration] = new_simulation(self.devices[configuration], (x, y), hand)
            self._simulations[configuration].hand.grips["target"][0, :2] = (x, y)
        return self._simulations[configuration]

    def _simulated_trial(self, planned: PlannedTrial) -> Trial:
        generator = None
        if self.person:  # the same noise for every controller and configuration
            key = [self.protocol.seed, participant_index(self.participant), planned.segment, planned.repetition]
            generator = np.random.default_rng(np.random.SeedSequence(key))
        return Trial(
            self.simulation(planned.configuration), planned, self.protocol.paths[planned.segment],
            self.preset(planned), self.protocol.rules, self.protocol.trial, self.person, generator,
        )  # fmt: skip

    def _linked_trial(self, planned: PlannedTrial) -> LinkedTrial:
        return LinkedTrial(
            self.devices[planned.configuration], planned, self.protocol.paths[planned.segment],
            self.preset(planned), self.protocol.rules, self.protocol.trial,
        )  # fmt: skip
