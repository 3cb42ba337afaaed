"""The steps of `phd bring-up` from the device page: the loop does them, the server keeps the record."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from bring_up_bench import BuiltBench, shortened
from fake_client import opened, ready
from page_driver import PageDriver, texts
from protocols import PAPER, changed
from simulated_bench import DEVICE
from simulated_loop import local_window
from status_messages import ON_BENCH, WELL, status
from test_board_session import OnBench

from app.ipc import messages as m
from app.ipc.messages import Setup
from app.loop import guided_bring_up
from app.window.device.device_page import DevicePage
from experiments.bring_up.record import newest_record
from experiments.bring_up.step import Step
from experiments.bring_up.steps import steps_for

STEPS = ("quiet", "encoder A", "stop")  # a few of them, for each look of this server is 20 ms of the board's time


@pytest.fixture
def built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[OnBench]:
    def few(*about) -> list[Step]:
        steps = {step.name: step for step in shortened(steps_for(*about))}
        return [steps[name]._replace(lasts_s=min(steps[name].lasts_s, 0.5), needs=()) for name in STEPS]

    monkeypatch.setattr(guided_bring_up, "steps_for", few)
    protocol = tmp_path / "one.toml"
    protocol.write_text(changed(PAPER.text, hold_s="0.0"), encoding="utf-8")
    board = BuiltBench(DEVICE, "dead-encoder")
    setup = Setup(tmp_path / "data", str(protocol), devices=(DEVICE.name,), link="bench", sync=False)
    with local_window(setup, board) as window:
        yield OnBench(window, board)
    assert not any(board.board.currents)


def begin(built: OnBench) -> None:
    built.window.until_stage(m.NO_SESSION)
    built.send(m.Open("01"))
    built.until(lambda s: s.card and "Hold the handle" in s.card.text)
    built.send(m.PrepareDevice(m.BRING_UP, "A. Builder"))


def do_what_is_asked(built: OnBench, orders: dict[str, dict]) -> None:
    """Until it is over: the hand obeys once a step, and the window says when it is done."""
    shown, told = "", set()

    def over() -> bool:
        nonlocal shown
        running = built.status.bring_up
        if running and running.title != shown:
            shown = running.title
            built.board.hand.obey(orders.get(shown, {"do": "let go"}))
        if running and running.confirmed and built.board.hand.is_done and shown not in told:
            told.add(shown)
            built.send(m.PrepareDevice(m.GO_ON))
        return bool(shown) and running is None

    built.until(over)


def test_the_window_leads_through_the_steps_and_the_session_keeps_the_record(built: OnBench, tmp_path: Path) -> None:
    begin(built)
    built.until(lambda: built.status.bring_up is not None)
    assert len(built.status.bring_up.steps) == len(STEPS)
    built.until(lambda: built.status.counts)  # its picture follows meanwhile
    built.send(m.Start())  # not meanwhile
    do_what_is_asked(built, {"Emergency stop": {"do": "press stop"}})
    built.until(lambda s: s.notice_bad and "Not every step has passed" in s.notice)
    found = newest_record(tmp_path / "data", "TEST")
    assert found is not None and found.by == "A. Builder" and not found.passed
    assert list(found.steps.values()) == ["passed", "failed", "passed"]


def test_it_can_be_broken_off(built: OnBench) -> None:
    begin(built)
    built.until(lambda: built.status.bring_up and built.status.bring_up.confirmed)
    built.send(m.PrepareDevice(m.BREAK_OFF))
    built.until(lambda s: s.notice_bad and "broken off" in s.notice)
    built.until(lambda: built.status.bring_up is None)


def test_the_page_shows_the_step_and_what_was_seen(qtbot) -> None:
    driver = PageDriver(qtbot, DevicePage)
    page = driver.page
    page.show_opened(opened(**ON_BENCH))
    page.show_snapshot(ready(3, checks=WELL))
    page.show_pulse(m.Pulse(None, None, 0, device=status()))
    page.ask_bring_up.click()
    assert page.bring_up.isVisible() and not page.why.isVisible() and not page.bring_up.begin.isEnabled()
    page.bring_up.name.setText("A. Builder")
    page.bring_up.begin.click()
    assert driver.sent[-1] == m.PrepareDevice(m.BRING_UP, "A. Builder")
    results = (("Version, limits, clock", "passed", "a board", ""), ("Encoder", "failed", "no counts", "Plug it in."))
    steps = ("Version, limits, clock", "Encoder", "Emergency stop", "Latency and jitter")
    shown = m.BringUpShown("Emergency stop", "Press it.", True, results, steps)
    page.show_pulse(m.Pulse(None, None, 0, device=status(bring_up=shown)))
    shown = texts(page.bring_up)
    assert all(text in shown for text in (*steps, "Press it.", "Plug it in.", "Step 3 of 4", "▶"))
    page.bring_up.go_on.click()
    page.bring_up.end.click()
    assert [command.step for command in driver.sent[-2:]] == [m.GO_ON, m.BREAK_OFF]
    page.show_pulse(m.Pulse(None, None, 0, device=status()))
    page.bring_up.end.click()
    assert page.why.isVisible() and not page.bring_up.isVisible()
