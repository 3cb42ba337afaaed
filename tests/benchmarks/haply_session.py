"""`python -m tests.benchmarks.haply_session [TRIALS] [--terminal]`: a session on the mock of a Haply 2diy beside the
same trials on the simulated device with brakes, and how a lock feels on both: the tables of docs/haply.md.

Whole sessions with a simulated person: plant, board's bytes, driver, filter, trial, recording, table, headless and in
simulated time, for the plant is the clock. --terminal: the bytes go over a pseudo-terminal, with the driver's watchdog.
"""

import sys
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path
from typing import NamedTuple

import numpy as np

from core import tick_log
from core.device import load_device
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.metrics import Metrics
from experiments.analysis.trials_table import TrialRow
from experiments.protocol import load_protocol
from experiments.recording.schema import Sensors
from experiments.session.session import Participant, Session
from experiments.trial.population import load_population
from experiments.trial.real_trial import RealTrial
from hardware.emulated_board.device import HeldHand
from hardware.haply.device import HaplyDevice
from tests.benchmarks.board_bench import settings
from tests.benchmarks.board_trials import Setting, exchanged, on_the_simulated_device

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support")]
from haply_mock import MockHaply, Served  # noqa: E402
from real_bench import Late  # noqa: E402

DEVICE = load_device("haply-2diy")
TIP = (0.0, 0.11)
SHOWN = {"path_error_m": 1e3, "mean_tip_force_N": 1.0, "chatter_per_s": 1.0}


class Ran(NamedTuple):
    """A trial on the mock."""

    row: TrialRow
    force_off: np.ndarray  # (n, 2) N: the estimated force of the hand in the movement, less the true one
    given_J: tuple[float, float]  # by each motor at the moment when it had given most, by the plant
    report: dict  # of the driver


def one_trial(session: Session, setting: Setting, terminal: bool) -> Ran:
    """A trial from its first tick to its row."""
    operator = setting.operator()
    hand = Late(operator)
    mock = MockHaply(setting.device, hand, setting.start)
    served = Served(mock) if terminal else None
    link = (
        HaplyDevice(setting.device, served.port, clock=mock.now)
        if served
        else HaplyDevice(setting.device, mock.name, clock=mock.now, open_port=mock.open, sleep=mock.sleep)
    )
    link.open()
    link.home(setting.start)
    trial, writer = session.begin(setting.planned, Sensors(link.encoders, link.force_channels))
    assert isinstance(trial, RealTrial)
    off, given = [], np.zeros(2)
    with writer:
        trial.connect(link)
        hand.begun = True
        for rows in exchanged(trial, operator, lambda: mock.ticks):
            writer.write(np.array(rows).reshape(-1, tick_log.BENCH_WIDTH))
            given = np.maximum(given, mock.plant.work)
            if rows and trial.phase == "move":
                off.append(np.subtract(rows[-1][tick_log.HAND_FX : tick_log.HAND_FY + 1], mock.plant.true_force))
        row = session.finish(trial, writer)
    report = link.report()
    link.close()
    if served:
        served.close()
    return Ran(row, np.array(off).reshape(-1, 2), (float(given[0]), float(given[1])), report)


class Locked:
    """The handle with both brakes locked, on the mock or with brakes, and a hand that pushes it along x."""

    def __init__(self, on_mock: bool) -> None:
        self._hand = HeldHand(TIP)
        grip = self._hand.hand.grips
        grip["stiffness"][0], grip["damping"][0], grip["mass"][0] = 0.0, (5.0, 0.0, 5.0), 0.0  # an arm's damping
        self._wave = grip["wave"][0]
        grip["waves"][0] = 1
        self._push = grip["held"][0]
        self._ticks, self._most = 0, DEVICE.brakes.current_max
        self._mock = MockHaply(DEVICE, self._hand, TIP) if on_mock else None
        self._braked = SimulatedDevice(DEVICE, TIP, self._hand.hand)
        if self._mock:
            mock = self._mock
            self._link = HaplyDevice(DEVICE, mock.name, clock=mock.now, open_port=mock.open, sleep=mock.sleep)
            self._link.open()
            self._link.home(TIP)

    def push(self, seconds: float, force: float, tremor: float = 0.0) -> np.ndarray:
        """For so long, N, with a tremor of 9 Hz, N; (n, 3): x (m) and torques (N m) of A and B, tick by tick."""
        self._push[0], self._wave[0, :2] = force, (tremor, 18.0 * np.pi)
        seen = []
        for _ in range(round(1000 * seconds)):
            if self._mock:
                self._link.exchange(self._most)
                seen.append((self._mock.plant.tip[0], *self._mock.plant.torques))
            else:
                self._braked.move(self._most, 1e-3 * self._ticks, 1e-3)
                state = self._braked.state
                seen.append((self._braked.tip[0], state["torque"][0, 0], state["torque"][0, 2]))
            self._ticks += 1
        return np.array(seen)


def feel(on_mock: bool) -> dict[str, float]:
    """Of a lock: what a hand that pushes with 0.5 N, then trembles with 0.15 N, then pushes through, finds."""
    locked = Locked(on_mock)
    locked.push(0.3, 0.0)
    at_rest = locked.push(2.0, 0.5)[-1000:]
    trembling = locked.push(10.0, 0.5, 0.15)
    first, last = trembling[1000:2000, 0].mean(), trembling[-1000:, 0].mean()
    through = locked.push(0.05, 3.0)[-1, 0]
    let_go = locked.push(1.0, 0.0)[:, 0]
    return {
        "stick displacement at 0.5 N (mm)": 1e3 * float(at_rest[-1, 0]),
        "creep at rest (um/s)": 1e6 * float(at_rest[-1, 0] - at_rest[0, 0]),
        "creep with tremor (um/s)": 1e6 * float(last - first) / 8.0,
        "chatter at rest (mN m/s)": 1e3 * float(np.abs(np.diff(at_rest[:, 1:], axis=0)).sum()),
        "chatter with tremor (mN m/s)": 0.1e3 * float(np.abs(np.diff(trembling[:, 1:], axis=0)).sum()),
        "springs back when let go (mm)": 1e3 * float(through - let_go[-1]),
    }


def main(arguments: list[str]) -> int:
    """Prints the tables. 1: a motor gave more energy than its allowance."""
    trials = next((int(word) for word in arguments if word.isdigit()), 60)
    terminal, protocol, population = "--terminal" in arguments, load_protocol("haply"), load_population()
    coming = settings(protocol)[:trials]
    cells: dict[str, list[tuple[Ran, Metrics]]] = defaultdict(list)
    ends: Counter[str] = Counter()
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        person = Participant("01", operator=coming[0].person, population=population.operators)
        session = Session(Path(name), person, protocol, sync=False)
        try:
            for setting in coming:
                ran = one_trial(session, setting, terminal)
                status, braked = on_the_simulated_device(setting)
                cells[setting.preset.name].append((ran, braked))
                ends[f"{ran.row.status} ({status} with brakes)"] += 1
                print(".", end="", flush=True)
        finally:
            session.close()
    print(f" {len(coming)} trials in {time.perf_counter() - began:.0f} s: {dict(ends)}")
    print("| controller | trials | path error (mm) | with brakes | force (N) | with brakes | chatter | with brakes |")
    for name, pairs in sorted(cells.items()):
        shown = [
            f"{scale * float(np.mean(values)):.2f}"
            for measure, scale in SHOWN.items()
            for values in ([ran.row.value(measure) for ran, _ in pairs], [brakes[measure] for _, brakes in pairs])
            if None not in values
        ]
        print(f"| {name} | {len(pairs)} | {' | '.join(shown)} |")
    everything = [ran for pairs in cells.values() for ran, _ in pairs]
    off = np.concatenate([ran.force_off for ran in everything])
    print(f"force of the hand: {np.sqrt((off**2).mean(axis=0))} N rms off along x and y, 95 % within "
          f"{np.percentile(np.hypot(*off.T), 95):.2f} N")  # fmt: skip
    given = max(max(ran.given_J) for ran in everything)
    allowed = 1e-3 * max(everything[0].report["allowed_mJ"])
    print(f"energy: at most {1e3 * given:.3f} mJ given at any moment of a trial, {1e3 * allowed:.3f} mJ allowed; "
          f"the guard acted {sum(ran.report['guarded'] for ran in everything)} times; "
          f"warmest winding {max(max(ran.report['winding_C']) for ran in everything)} degC")  # fmt: skip
    print("| feel | mock | with brakes |")
    mock, braked = feel(True), feel(False)
    for measure, value in mock.items():
        print(f"| {measure} | {value:.2f} | {braked[measure]:.2f} |")
    return int(given > allowed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
