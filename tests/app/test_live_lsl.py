"""Ticks and markers for other recorders, as an inlet of the Lab Streaming Layer gets them."""

import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from live import live_window
from protocols import PAPER, changed
from refusals import refusal
from waiting import LONG_S, wait_until

from app.ipc import messages as m
from app.ipc.messages import Setup
from app.ipc.ring import MOST_BEHIND_NS, Ring
from app.session_server.lsl import MARKERS, TICKS, Outlets
from core import tick_log
from experiments.inputs import OPERATOR
from experiments.store.journal import NOTE, now

#: streams stay on this computer, whatever networks it has
SETTINGS = "[log]\nlevel = -2\n[multicast]\nResolveScope = machine\n[lab]\nKnownPeers = {127.0.0.1}\n"
NAMES = [column.name for many in tick_log.COLUMNS if many.of != tick_log.BENCH for column in many.spread()]
BENCH_NAMES = [column.name for many in tick_log.COLUMNS if many.of != tick_log.SIMULATED for column in many.spread()]


@pytest.fixture(scope="module", autouse=True)
def lsl(tmp_path_factory: pytest.TempPathFactory) -> Iterator:
    settings = tmp_path_factory.mktemp("lsl") / "lsl_api.cfg"
    settings.write_text(SETTINGS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LSLAPICFG", str(settings))
        yield pytest.importorskip("pylsl", reason="pylsl is not installed")


class Inlet:
    """A stream's samples so far, with their times."""

    def __init__(self, lsl, name: str) -> None:
        found: list = []
        wait_until(lambda: found.extend(lsl.resolve_byprop("name", name, 1, 1.0)) or found)
        self._inlet = lsl.StreamInlet(found[0])
        self.about = self._inlet.info(LONG_S)
        self._inlet.open_stream(LONG_S)
        self.samples: list = []
        self.times: list[float] = []

    def until(self, n: int) -> None:
        """Until n samples have come."""
        wait_until(lambda: self.look() or len(self.samples) >= n)

    def look(self) -> None:
        samples, times = self._inlet.pull_chunk(timeout=0.02)
        self.samples += list(samples)
        self.times += list(times)

    def channels(self, what: str) -> list[str]:
        channel = self.about.desc().child("channels").first_child()
        found = []
        for _ in range(self.about.channel_count()):
            found.append(channel.child_value(what))
            channel = channel.next_sibling()
        return found

    def close(self) -> None:
        self._inlet.close_stream()


@pytest.fixture
def streams(lsl, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[SimpleNamespace]:
    real = getattr(request, "param", False)
    ring = Ring(ticks=64)
    outlets = Outlets(ring, real, tmp_path)
    offset_s = max(lsl.local_clock() - time.perf_counter() for _ in range(20))  # where nothing came between
    made = SimpleNamespace(
        ring=ring, outlets=outlets, ticks=Inlet(lsl, TICKS), markers=Inlet(lsl, MARKERS), offset_s=offset_s
    )  # fmt: skip
    yield made
    made.ticks.close()
    made.markers.close()


def rows_at(times: np.ndarray, width: int = tick_log.WIDTH) -> np.ndarray:
    rows = np.zeros((len(times), width))
    rows[:, tick_log.T] = times
    return rows


def assert_at(times: list[float], due_s: np.ndarray) -> None:
    """That samples have these times: within a millisecond of the clock, and apart as they are due."""
    off_s = np.subtract(times, due_s)
    assert np.abs(off_s).max() < 1e-3 and np.ptp(off_s) < 2e-5


def test_columns_come_with_name_and_unit_from_their_declaration(streams: SimpleNamespace) -> None:
    assert streams.ticks.channels("label") == NAMES
    units = dict(zip(NAMES, streams.ticks.channels("unit"), strict=True))
    assert (units["tip_x_m"], units["current_A_A"], units["torque_B_N_m"]) == ("m", "A", "N m")
    assert streams.ticks.about.nominal_srate() == 1000.0
    clock = streams.ticks.about.desc().child("clock")
    assert float(clock.child_value("offset_s")) == pytest.approx(streams.offset_s, abs=1e-3)


def test_each_tick_has_the_time_at_which_it_was_due_also_behind_a_stall(streams: SimpleNamespace) -> None:
    began_s, stall_s = time.perf_counter() - 1.0, 1e-9 * MOST_BEHIND_NS + 0.05
    streams.ring.control.begun = round(1e9 * began_s)
    times = 1e-3 * np.arange(60)
    rows = rows_at(times)
    rows[5, tick_log.LATENESS_US] = 5e4  # made up for: nothing waits
    rows[20, tick_log.LATENESS_US] = 1e6 * stall_s
    take = streams.outlets.begin(7)
    for chunk in np.split(rows, [1, 15, 21, 40]):
        take(chunk)
    streams.ticks.until(len(rows))
    due_s = began_s + times + np.where(np.arange(60) > 20, stall_s, 0.0) + streams.offset_s
    assert_at(streams.ticks.times, due_s)
    assert np.array_equal(np.array(streams.ticks.samples)[:, NAMES.index("t_s")], times)


@pytest.mark.parametrize("streams", [True], indirect=True)
def test_on_the_bench_the_time_is_that_of_the_sample_and_a_lost_one_follows_the_one_before(streams) -> None:
    times, began_s = 1e-3 * np.arange(10), time.perf_counter() - 1.0
    rows = rows_at(times, tick_log.BENCH_WIDTH)
    rows[:, tick_log.HOST_S] = began_s + times * (1.0 + 1e-3)  # a board's clock drifts
    rows[[3, 4, 8], tick_log.HOST_S] = np.nan
    take = streams.outlets.begin(7)
    for chunk in np.split(rows, [4, 5]):
        take(chunk)
    streams.ticks.until(len(rows))
    assert streams.ticks.channels("label") == BENCH_NAMES
    due_s = rows[:, tick_log.HOST_S] + streams.offset_s
    due_s[[3, 4, 8]] = due_s[[2, 2, 7]] + [1e-3, 2e-3, 1e-3]
    assert_at(streams.ticks.times, due_s)


def test_a_line_that_waited_for_the_disk_has_the_time_of_its_event(streams: SimpleNamespace) -> None:
    at = now()
    time.sleep(0.3)
    streams.outlets.mark(NOTE, {"text": "late", "time": at})
    streams.outlets.mark(NOTE, {"text": "now"})
    streams.markers.until(2)
    assert [json.loads(*sample) for sample in streams.markers.samples] == [
        {"event": "note", "text": "late"}, {"event": "note", "text": "now"},
    ]  # fmt: skip
    assert 0.29 < streams.markers.times[1] - streams.markers.times[0] < LONG_S


def test_streams_that_fail_are_given_up_and_say_so(streams: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no more")

    monkeypatch.setattr("pylsl.StreamOutlet.push_chunk", broken)
    streams.outlets.begin(1)(rows_at(np.zeros(1)))
    assert streams.outlets.failure == "The LSL streams have ended (no more). The recording goes on."


def test_without_pylsl_the_terminal_says_what_to_type_and_nothing_is_written(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", None)
    told = refusal(capsys, "run", "--lsl", "--data-dir", tmp_path / "data")
    assert told == f"phd: --lsl: pylsl is not installed. Type: {sys.executable} -m pip install pylsl\n"
    assert not (tmp_path / "data").exists()


def test_an_inlet_gets_every_tick_of_a_trial_with_its_time_and_markers_in_order(lsl, tmp_path: Path) -> None:
    protocol = tmp_path / "quick.toml"
    protocol.write_text(changed(PAPER.text, hold_s="0.1", end_radius_m="0.08"), encoding="utf-8")
    setup = Setup(tmp_path / "data", str(protocol), hand=OPERATOR, sync=False, lsl=True)
    with live_window(setup) as window:
        ticks, markers = Inlet(lsl, TICKS), Inlet(lsl, MARKERS)
        window.open()
        before_s = lsl.local_clock()
        window.start()
        window.until_stage(m.READY)
        after_s = lsl.local_clock()
        recording = window.recording(1)
        ticks.until(recording.rows)
        wait_until(lambda: markers.look() or any("trial ended" in text for (text,) in markers.samples))
        ticks.look()
        streamed, times = np.array(ticks.samples), np.array(ticks.times)
        assert len(streamed) == recording.rows
        for name in ("t_s", "tip_x_m", "tip_vy_m_s", "current_A_A", "lateness_us"):
            assert np.array_equal(streamed[:, NAMES.index(name)], recording.column(name)), name
        steps_s = np.diff(times) - 1e-3
        late_s = 1e-6 * recording.column("lateness_us")[:-1]
        assert np.allclose(steps_s, np.where(late_s >= 1e-9 * MOST_BEHIND_NS, late_s, 0.0), atol=1e-3)
        assert before_s < times[0] and times[-1] < after_s
        marks = [json.loads(*sample) for sample in markers.samples]
        assert [mark["event"] for mark in marks] == ["created", "trial begun", *4 * ["phase"], "trial ended"]
        assert [mark["phase"] for mark in marks if mark["event"] == "phase"] == list(tick_log.PHASES)
        assert marks[1]["run"] == marks[2]["run"] == marks[-1]["run"] == 1 and marks[-1]["status"] == "done"
        assert markers.times == sorted(markers.times)
        move_s = recording.column("t_s")[np.flatnonzero(recording.in_phase("move"))[0]]
        assert markers.times[4] - times[0] == pytest.approx(move_s, abs=1e-3)
        for inlet in (ticks, markers):
            inlet.close()
