"""`python -m tests.benchmarks.haply_session [TRIALS] [--terminal]`: a session on the mock of a Haply 2diy beside the same
trials on the simulated device with brakes, and how its brakes feel: the table of docs/haply.md.

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

from app.emulated_operator import EmulatedOperator
from core import tick_log
from core.device import load_device
from core.path import build_path
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
from tests.benchmarks.board_trials import LONGEST_TICKS, Setting, on_the_simulated_device

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support")]
from haply_mock import MockHaply, Served  # noqa: E402

DEVICE = load_device("haply-2diy")
TIP = (0.0, 0.11)
SHOWN = {"path_error_m": 1e3, "mean_tip_force_N": 1.0, "chatter_per_s": 1.0}


class Late:
    """A person who begins with the trial."""

    def __init__(self, operator: EmulatedOperator) -> None:
        self.operator, self.hand, self.begun = operator, operator.hand, False

    def tick(self, x: float, y: float) -> None:
        if self.begun:
            self.operator.tick(x, y)

    def obey(self, order: dict) -> None:
        """Nobody gives orders here."""


class Ran(NamedTuple):
    """A trial on the mock."""

    row: TrialRow
    force_off: np.ndarray  # (n, 2) N: the estimated force of the hand in the movement, less the true one
    given_J: tuple[float, float]  # by each motor at the moment when it had given most, by the plant
    report: dict  # of the driver


def one_trial(session: Session, setting: Setting, terminal: bool) -> Ran:
    """A trial from its first tick to its row."""
    path = build_path(session.protocol.paths[setting.planned.segment], "path")
    operator = EmulatedOperator(setting.person, path, setting.start, setting.generator())
    operator.go_on = lambda x, y: None  # it goes by the phases of the trial alone
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
        while not trial.finished and mock.ticks < LONGEST_TICKS:
            phase = tick_log.PHASES.index(trial.phase)
            if phase != operator.phase:
                operator.enter(phase)
            rows = trial.exchange()
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


def feel() -> dict[str, float]:
    """A hand of 300 N/m and 5 N s/m that pulls the locked handle aside, rests, pulls it through and lets go."""
    hand = HeldHand(TIP)
    grip = hand.hand.grips
    grip["stiffness"][0], grip["damping"][0], grip["mass"][0] = (300.0, 0.0, 300.0), (5.0, 0.0, 5.0), 0.0
    mock = MockHaply(DEVICE, hand, TIP)
    link = HaplyDevice(DEVICE, mock.name, clock=mock.now, open_port=mock.open, sleep=mock.sleep)
    link.open()
    link.home(TIP)
    most = DEVICE.brakes.current_max
    tips, torques = [], []
    for n in range(4000):
        aside = 0.0 if n < 300 else min(1e-5 * (n - 300), 0.003) if n < 3000 else 0.0
        grip["target"][0, :2] = TIP[0] + aside, TIP[1]
        link.exchange(most)
        tips.append(mock.plant.tip)
        torques.append(mock.plant.torques.copy())
    x = 1e3 * (np.array(tips)[:, 0] - TIP[0])
    changes = np.abs(np.diff(np.array(torques), axis=0)).sum(axis=1)
    still = slice(1000, 3000)
    return {
        "pull_N": 300.0 * (0.003 - 1e-3 * float(x[999])), "stick_mm": float(x[999]),
        "creep_um_s": 1e3 * float(x[2999] - x[1000]) / 2.0, "ripple_um": 1e3 * float(x[still].std()),
        "chatter_mNm_s": 1e6 * float(changes[still].mean()), "left_mm": float(x[-1]),
    }  # fmt: skip


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
    print("| controller | trials | path error (mm) | with brakes | tip force (N) | with brakes | chatter | with brakes |")
    for name, pairs in sorted(cells.items()):
        shown = [
            f"{scale * float(np.mean([value for value in values if value is not None])):.2f}"
            for measure, scale in SHOWN.items()
            for values in ([getattr(ran.row, measure) for ran, _ in pairs], [brakes[measure] for _, brakes in pairs])
        ]
        print(f"| {name} | {len(pairs)} | {' | '.join(shown)} |")
    everything = [ran for pairs in cells.values() for ran, _ in pairs]
    off = np.concatenate([ran.force_off for ran in everything])
    print(f"force of the hand: {np.sqrt((off**2).mean(axis=0))} N rms off along x and y, 95 % within "
          f"{np.percentile(np.hypot(*off.T), 95):.2f} N")  # fmt: skip
    given = max(max(ran.given_J) for ran in everything)
    allowed = 1e-3 * max(everything[0].report["allowed_mJ"])
    print(f"energy: at most {1e3 * given:.3f} mJ given at any moment of a trial, {1e3 * allowed:.3f} mJ allowed; "
          f"the guard acted {sum(sum(ran.report['guarded']) for ran in everything)} times; "
          f"warmest winding {max(max(ran.report['winding_C']) for ran in everything)} degC")  # fmt: skip
    print("feel:", {name: round(value, 4) for name, value in feel().items()})
    return int(given > allowed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
