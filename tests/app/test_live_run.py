"""A live trial and its recording when the disk fails or falls behind: the loop is a process, the rest is here."""

import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace
from recorded import new_session_database
from waiting import LONG_S, wait_until

from app.ipc.jobs import Prepared, TrialReturned
from app.ipc.ring import Ring
from app.loop.real_time import ROOM
from app.session_server.loop_process import LoopProcess
from app.session_server.recorder import Recorder
from app.session_server.trial_runner import TrialRun
from core import tick_log
from core.simulator.simulated_device import SimulatedDevice
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.store.journal import NOTE, JournalWriter, read_events
from experiments.store.recording import RecordingWriter, Written
from experiments.trial.operator import Person
from experiments.trial.population import load_population
from experiments.trial.trial import Conditions, SimulatedTrial, Trial

SMALL = ROOM + 5000  # ticks: a disk may fall 5 s behind, and so may this process
SOMEBODY = load_population().draw(np.random.default_rng(1))


@pytest.fixture(scope="module")
def loop():
    """A ring and a prepared loop."""
    ring = Ring(ticks=SMALL)
    process = LoopProcess(ring, real_time=False)
    wait_until(lambda: ring.beat() or any(isinstance(answer, Prepared) for answer in process.receive()))
    yield ring, process
    process.close()


class Disk:
    """A recording's writer whose disk does what the test wants."""

    name, written, is_full = "run-001", Written(0, 0), False
    database = SimpleNamespace(pending=0, trouble=None, longest_sync_s=0.0)

    def __init__(self, error: OSError | None = None) -> None:
        self.error, self.free, self.rows = error, threading.Event(), []

    def write(self, rows: np.ndarray) -> None:
        self.free.wait(LONG_S)
        if self.error:
            raise self.error
        self.rows.append(rows)


def run_trial(loop: tuple[Ring, LoopProcess], disk: Disk, trial: Trial, ticks: int = 10**9) -> TrialRun:
    """A trial until something, or so many recorded ticks, end it."""
    ring, process = loop
    run = TrialRun(ring, process, trial, disk)
    end = time.perf_counter() + LONG_S
    ring.control.server_beat = 1 << 62  # however long this machine holds us up: that is not what is tested
    while not (answers := [answer for answer in process.receive() if isinstance(answer, TrialReturned)]):
        if why := run.recorder.error or ("enough" if len(run.recorder.lateness_us) >= ticks else ""):
            run.stop(why)
        assert time.perf_counter() < end
        time.sleep(0.005)
    disk.free.set()
    run.returned(answers[0], "default")
    return run


def new_one(person: Person | None = None) -> Trial:
    """A trial of a simulated operator, or at a mouse that nobody moves; it goes on until it is ended."""
    protocol = load_protocol()
    rules = replace(protocol.trial, end_radius_m=1e-9, time_out_s=500.0)
    path, preset = protocol.paths[1], protocol.controllers[1]
    simulation = SimulatedDevice(protocol.devices[0], (0.0, 0.35), None if person else protocol.mouse.hand())
    planned = PlannedTrial(0, 0, "three-brake", 1, 1, 1)
    generator = np.random.default_rng(2)
    return SimulatedTrial(simulation, planned, Conditions(path, preset, protocol.rules, rules), person, generator)


def test_a_disk_that_falls_behind_ends_the_trial_and_still_gets_every_tick(loop) -> None:
    disk = Disk()
    run = run_trial(loop, disk, new_one())
    outcome, rows = run.trial.outcome(), np.concatenate(disk.rows)
    assert outcome["status"] == "aborted" and "the disk could not keep up" in outcome["reason"]
    assert outcome["timing"]["lost"] == 0 and outcome["timing"]["ticks"] == len(rows) == run.trial.ticks
    assert np.allclose(np.diff(rows[:, tick_log.T]), 1e-3)
    assert not rows[-1, tick_log.CURRENT : tick_log.CURRENT + 4].any()


def test_a_full_disk_ends_no_trial_while_memory_takes_its_ticks_and_ends_it_when_that_does_not(loop) -> None:
    disk = Disk(OSError(28, "No space left on device"))
    disk.free.set()
    run = run_trial(loop, disk, new_one(), ticks=300)
    assert run.trial.outcome()["reason"] == "enough"
    disk = Disk()
    disk.free.set()
    disk.is_full = True
    run = run_trial(loop, disk, new_one())
    assert run.trial.outcome()["reason"] == "the recording failed: neither disk nor memory has room"


def test_a_live_trial_is_the_simulated_one_to_the_last_bit_and_leaves_the_device_the_same(loop) -> None:
    person, disk = SOMEBODY, Disk()
    disk.free.set()
    run = run_trial(loop, disk, new_one(person), ticks=800)
    rows, here = np.concatenate(disk.rows), new_one(person)
    expected = np.empty((800, tick_log.WIDTH))
    here.run(expected)
    rows[:, tick_log.LATENESS_US] = 0.0
    assert np.array_equal(rows[:800], expected, equal_nan=True) and np.ptp(expected[:, tick_log.TIP_X]) > 0.01
    assert run.trial.finished and run.trial.ticks == len(rows) > 800
    assert run.trial.outcome()["reason"] == "enough"
    assert abs(run.trial.outcome()["energy_residual_J"]) < 1e-6


def test_the_start_is_held_by_a_hand_and_not_by_a_handle_that_lies_there(loop) -> None:
    ring, process = loop
    protocol = load_protocol()
    path, preset = protocol.paths[1], protocol.controllers[1]
    at_start = SimulatedDevice(protocol.devices[0], path.start_m, protocol.mouse.hand())
    rules = replace(protocol.trial, time_out_s=500.0)
    planned = PlannedTrial(0, 0, "three-brake", 1, 1, 1)
    for touched, later in ((False, set()), (True, {tick_log.HOLD, tick_log.MOVE})):
        ring.control.aim_count = 0
        if touched:
            ring.aim(*path.start_m)
        disk = Disk()
        disk.free.set()
        trial = SimulatedTrial(
            at_start, planned, Conditions(path, preset, protocol.rules, rules), None, np.random.default_rng(2)
        )
        run_trial(loop, disk, trial, ticks=800)
        assert set(np.concatenate(disk.rows)[:, tick_log.PHASE].astype(int)) & {tick_log.HOLD, tick_log.MOVE} == later
    ring.control.aim_count = 0


def test_a_trial_that_has_ended_stays_what_it_is_whatever_is_pressed_then(loop) -> None:
    ring, _ = loop
    disk, trial = Disk(), new_one(SOMEBODY)
    disk.free.set()
    trial.arguments().run["approach_ticks"][0] = 300  # it ends by itself
    trial.arguments().run["end_ticks"][0] = 1500
    write = disk.write

    def press_late(rows: np.ndarray) -> None:
        write(rows)
        if len(rows) and rows[-1, tick_log.PHASE] == tick_log.END:
            ring.control.stop = 1

    disk.write = press_late
    run = run_trial(loop, disk, trial)
    assert ring.control.stop == 1 and "start was not reached" in run.trial.outcome()["reason"]


def test_an_event_of_a_running_trial_is_on_the_disk_before_the_next_tick_is_due_there(tmp_path: Path) -> None:
    database = new_session_database(tmp_path)
    recorder = Recorder(Ring(ticks=SMALL), RecordingWriter(database, ("trials", 1), "A", {}))
    JournalWriter(database).write(NOTE, text="the lamp flickers")
    wait_until(lambda: not database.pending)
    (entry,) = read_events(tmp_path)
    assert entry.about == {"text": "the lamp flickers"}
    recorder.close()
    database.close()


def test_a_trial_that_a_person_forgets_ends_by_itself_and_says_why() -> None:
    trial, rows, ticks = new_one(), np.empty((10_000, tick_log.WIDTH)), 0
    while not trial.finished:
        ticks += trial.run(rows)
    assert 300.0 < 1e-3 * ticks < 1200.0
    assert trial.outcome()["status"] == "aborted" and "start was not reached" in trial.outcome()["reason"]
