"""The device page: what it shows of a device on the bench, what is wrong, and the steps that make it ready."""

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_client import DEVICES, PRESETS, opened, paper, ready, running
from page_driver import PageDriver, texts
from status_messages import LOST, NOT_ZEROED, ON_BENCH, WELL, status, told
from texts_on_screen import faults

from app.ipc import messages as m
from app.window.device.device_page import ASSUMED, SIMULATED, DevicePage
from app.window.device.device_view import FOLLOWS
from app.window.device.figures import RECENT_S, Rates, counters_of, quantisation, readiness, worth_a_look

DEVICE = next(device for device in DEVICES if device.name == "four-brake")


class Bench(PageDriver):
    """The device page, of a board that is well."""

    def __init__(self) -> None:
        super().__init__(DevicePage)
        self.page.show_setup(m.Setup(Path("data"), link="/dev/ttyACM0"))
        show(self.page, opened(**ON_BENCH), ready(3, checks=WELL))
        self.page.show_pulse(told(status()))


def show(page: DevicePage, session: m.Opened, snapshot: m.Snapshot) -> None:
    """The session server says this."""
    page.show_opened(session)
    page.show_snapshot(snapshot)


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def page(bench: Bench) -> DevicePage:
    return bench.page


def test_of_a_simulated_device_one_sentence_is_shown_and_of_a_board_that_it_is_being_opened(page: DevicePage) -> None:
    page.show_setup(m.Setup(Path("data"), link="/dev/ttyACM1"))
    assert "Opening /dev/ttyACM1 …" in texts(page) and not page.bench.isVisible(), "nothing of the board before"
    page.show_setup(m.Setup(Path("data")))
    show(page, opened(), ready(3))
    assert SIMULATED.format("Three-brake", ASSUMED) in texts(page) and not page.bench.isVisible()


def test_a_device_that_is_well_shows_all_that_its_board_and_link_report(page: DevicePage) -> None:
    page.raw.click()
    shown = texts(page)
    page.raw.click()
    shown += texts(page)
    for what in (
        "four-brake", "B-7 is connected", "0.9.0, protocol 1", "Ready: no current", "A B: homed at",
        "6 channels, zeroed at", "34\u202f512 counts", "120.32°", "computed", "x 20.0   y 380.0 mm",
        "UART at 2000 kbaud, by an ST-LINK", "5.0 N   x 3.0   y -4.0", "1.6 ms at best",
        "12 of 812\u202f357 samples", "+12 ppm", "± 35 µs",
    ):  # fmt: skip
        assert what in shown, what


def test_what_is_not_known_is_a_dash_and_never_an_old_value(page: DevicePage) -> None:
    page.show_pulse(told(status(problem="no sample for 200 ms", homed=False, counts=(), theta=())))
    sensors = [label.text() for name, label in page.values.items() if name.startswith("Joint") or name == "Handle"]
    assert set(sensors) == {"–"} and FOLLOWS not in texts(page)
    page.show_pulse(told(status(homed=False, tip=(math.nan, math.nan), hand_force=(math.nan, math.nan))))
    assert page.values["Tip force"].text() == page.values["Handle"].text() == "–"
    assert page.values["Joint A"].text() == "34\u202f512 counts"
    page.show_pulse(told(status(hand_force=(-0.004, 0.0))))
    assert page.values["Tip force"].text() == "0.0 N   x 0.0   y 0.0 N", "and nothing has no sign"


COUNTERS = {
    "lost": "lost", "frames_bad": "damaged", "late_commands": "late", "not_closed": "contradict", "refused": "refuses",
}  # fmt: skip


def test_a_counter_that_rises_is_worth_a_word_and_an_old_count_is_not() -> None:
    quiet = dict.fromkeys(counters_of(status().report), 0)
    for counter, says in COUNTERS.items():
        recent = Rates()
        assert recent.rates(0.0, quiet) == {}
        noisy = {**quiet, "samples": 1000, counter: 9}
        (found,) = worth_a_look(status(), recent.rates(1.0, noisy))
        assert says in found
        for second in range(2, 2 * int(RECENT_S)):
            noisy = {**noisy, "samples": noisy["samples"] + 1000}
            rates = recent.rates(float(second), noisy)
        assert worth_a_look(status(), rates) == []
        assert recent.rates(99.0, {**quiet, "samples": 100}) == {}, "another connection counts anew"


APART = {"offset_s": 0.0, "drift": 1e-3, "residual_s": 1e-5, "blocks": 10}
FEW = {**dict.fromkeys(counters_of(status().report), 0.0), "samples": 900.0}


def test_few_samples_clocks_that_run_apart_and_why_a_connection_was_lost_are_worth_a_word_each() -> None:
    for report, rates, says in (
        ({}, FEW, ["Only 900 of 1000"]), ({"clock": APART}, {}, ["unevenly"]),
        ({"clock": APART | {"blocks": 9}}, {}, []),
        ({"lost_links": 2}, {}, ["lost since the start: 2"]), ({"board_time_back": 1}, {}, ["board's clock: 1"]),
        ({"lost_links": 3, "begun_anew": 2}, {}, ["lost since the start: 3", "clock stood still: 2"]),
    ):  # fmt: skip
        found = worth_a_look(status(report), rates)
        assert len(found) == len(says) and all(what in one for what, one in zip(says, found, strict=True))


def test_what_encoders_give_before_they_are_homed_is_no_contradiction(page: DevicePage) -> None:
    for second, not_closed, homed in ((0, 0, False), (1, 900, False), (2, 950, True), (3, 950, True), (4, 999, True)):
        page.show_pulse(told(status({"samples": 1000 * second, "not_closed": not_closed}, homed=homed), float(second)))
        assert ("contradict" in texts(page)) == (second == 4) or second == 2


def test_a_gain_feels_the_encoders_as_far_as_their_steps_are_coarse(page: DevicePage) -> None:
    gain, step, noise, force = quantisation(DEVICE, status(), PRESETS)
    coarse = quantisation(DEVICE, status({"counts_per_rev": [48_000, 48_000]}), PRESETS)
    assert coarse[1] == pytest.approx(2.0 * step) and coarse[3] == pytest.approx(2.0 * force)
    assert gain == max(preset.value("gain_N_s_m") for preset in PRESETS.values())
    assert force == pytest.approx(gain * noise) and quantisation(DEVICE, status(homed=False), PRESETS) is None
    page.raw.click()
    assert "can be felt" in texts(page)
    gentle = {n: one._replace(values=tuple(0.001 * value for value in one.values)) for n, one in PRESETS.items()}
    show(page, opened(protocol=paper(controllers=gentle), **ON_BENCH), ready(3, checks=WELL))
    assert "can be felt" not in texts(page) and "too little to be felt" in texts(page)


def test_of_hardware_that_reports_no_state_nothing_is_claimed_but_that_it_is_there() -> None:
    found = readiness(ready(3, checks=WELL), status(board="")._replace(report={}), {})
    assert found["Board"].text == "Four-brake is connected" and found["Brakes"].text == "No fault"


def test_a_fault_stands_in_the_row_of_what_it_is_of() -> None:
    lost = m.Check("Device", m.BAD, "not connected", "No sample for 200 ms.")
    for state, off_by, row in (
        (status(problem="no sample"), "Esc was pressed", "Board"), (status(), "Esc was pressed", "Brakes"),
        (status(fault="too hot"), "", "Brakes"), (status(homed=False), "", "Encoders"), (None, "", "Board"),
    ):  # fmt: skip
        found = readiness(ready(3, checks=(lost, *WELL[1:]), brakes_off=off_by), state, {})
        assert [name for name, check in found.items() if check.state == m.BAD] == [row]


NOT_HOMED = m.Check("Device", m.DUE, "not homed yet", "Home the encoders.")
OFF = m.Check("Device", m.BAD, m.BRAKES_OFF, "Brakes off. The board was too hot.")
BEFORE, ALL = m.Snapshot(m.NO_SESSION, checks=WELL), {m.CONNECT, m.HOME, m.ZERO}
#: session, snapshot, the board's status -> what stands at the top, the main button and its command, steps of the rows
SHOWN = {
    "all is ready in a session": ("01", ready(3, checks=WELL), {}, "Ready", "The Run page goes on", None, ALL),
    "the board came back": (
        "01", ready(3, checks=WELL), {"report": {"lost_links": 1, "state": "READY"}}, "Ready, but see Link",
        "The Run page goes on", None, ALL,
    ),
    "no zero, before a session": (
        "", BEFORE._replace(checks=NOT_ZEROED), {"zeroed": False}, "Next: start zeroing the force sensor",
        "Take your hand off the handle", ("Start zeroing the force sensor", m.PrepareDevice(m.ZERO)), ALL,
    ),
    "the zero was refused": (
        "01", ready(3, checks=NOT_ZEROED, notice="The handle moved.", notice_bad=True), {"zeroed": False},
        "Next: start zeroing the force sensor", "The handle moved. Take your hand off",
        ("Start zeroing the force sensor", m.PrepareDevice(m.ZERO)), ALL,
    ),
    "not homed": (
        "01", ready(3, checks=(NOT_HOMED, *NOT_ZEROED[1:])), {"zeroed": False, "homed": False},
        "Next: start homing the encoders", "Hold the handle in its jig at x = 0 mm, y = 400 mm",
        ("Start homing the encoders", m.PrepareDevice(m.HOME)), ALL,
    ),
    "the board is lost": (
        "01", ready(3, checks=LOST), {"problem": "no sample for 200 ms"}, "Board: not connected", "No sample",
        None, {m.CONNECT},
    ),
    "a fault is latched on the board": (
        "01", ready(3, checks=(OFF, *WELL[1:]), brakes_off="too hot"), {"fault": "too hot"}, "Next: turn the brakes on",
        "too hot", ("Turn brakes on", m.AllowBrakes()), {m.CONNECT},
    ),
    "a step is being done": (
        "01", ready(3, checks=NOT_ZEROED, step=m.ZERO), {"zeroed": False}, "Zeroing …", "do not touch", None, set(),
    ),
    "a trial is running": ("01", running(3), {}, "Nothing to do here now", "between two trials", None, set()),
}  # fmt: skip


@pytest.mark.parametrize("case", SHOWN)
def test_the_page_says_what_comes_next_offers_it_and_sends_it(bench: Bench, page: DevicePage, case: str) -> None:
    session, snapshot, changes, title, text, main, can = SHOWN[case]
    page.show_pulse(told(status(**changes)))
    show(page, opened(session, **ON_BENCH), snapshot)
    assert page.title.text() == title and text in page.text.text() and page.text.text()[0].isupper()
    assert {step for step, pressed in page.again.items() if pressed.isEnabled()} == can
    assert page.main.isVisible() == (main is not None) and faults(page) == []
    if main is not None:
        words, command = main
        assert page.main.text() == words
        bench.click(page.main)
        assert bench.sent == [command]


def test_a_step_is_taken_again_after_a_question_that_says_what_it_needs(bench: Bench, page: DevicePage) -> None:
    show(page, opened(**ON_BENCH), ready(3, checks=WELL))
    page.show_pulse(told(status(tip=(0.0, 0.4))))  # in the jig
    for (step, pressed), says in zip(page.again.items(), ("made again", " mm", "hand off"), strict=True):
        bench.click(pressed)
        assert bench.sent == [] and says in page.cards.question.text.text()
        assert page.cards.leave() and page.cards.question is None and not page.cards.leave()
        bench.click(pressed)
        bench.click(page.cards.question.buttons[0])
        assert bench.sent == [m.PrepareDevice(step)] and page.cards.question is None
        bench.sent.clear()


def test_before_homing_in_a_wrong_jig_the_page_names_the_distance_and_asks(bench: Bench, page: DevicePage) -> None:
    page.show_pulse(told(status(tip=(0.0053, 0.4))))
    for answer, sent in ((0, []), (1, [m.PrepareDevice(m.HOME, sure=True)])):
        bench.click(page.again[m.HOME])
        bench.click(page.cards.question.buttons[0])
        assert "5.3 mm from its jig" in page.cards.question.text.text() and bench.sent == []
        page.show_pulse(told(status(tip=(0.0053, 0.4001))))
        assert page.title.text() == "Is this the right jig?"
        bench.click(page.cards.question.buttons[answer])
        assert bench.sent == sent and page.cards.question is None
