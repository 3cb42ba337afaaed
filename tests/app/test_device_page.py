"""The device page: what it says of a device on the bench, what is not well, and the steps that make it ready."""

import math

import pytest
from fake_client import DEVICES, GREEN, PRESETS, opened, ready, running
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from screens import Screens, cut_texts, opened_screens, settle, visible_texts
from status_messages import LOST, NOT_ZEROED, ON_BENCH, WELL, status, told

from app.ipc import messages as m
from app.window.device_page import SIMULATED
from app.window.device_words import RECENT_S, Rates, Recent, counters_of, not_well, quantisation
from core.faults import FAULTS, cause
from hardware.sensing.samples import FAULT_CODES

KEY, LEFT = Qt.Key, Qt.MouseButton.LeftButton
DEVICE = next(device for device in DEVICES if device.name == "four-brake")


@pytest.fixture
def screens(qtbot):
    yield from opened_screens()


def on_bench(screens: Screens, device=None, **snapshot):
    """The console with the page open, on a device on the bench."""
    console = screens.hear(opened(**ON_BENCH), ready(3, checks=WELL, **snapshot), told(device or status()))
    screens.press(KEY.Key_F3)
    assert console.device.isVisible()
    return console


def test_the_page_comes_by_key_and_by_the_light_of_the_device_and_goes_again(screens: Screens) -> None:
    console = screens.hear(opened(**ON_BENCH), ready(3, checks=WELL), told(status()))
    for show in (lambda: screens.press(KEY.Key_F3), lambda: QTest.mouseClick(console.preflight.pills[0], LEFT)):
        for leave in (KEY.Key_F3, KEY.Key_Escape):
            show()
            assert console.device.isVisible() and not console.desk.isVisible()
            screens.press(leave)
            assert console.desk.isVisible()
    assert screens.client.off_causes == []
    QTest.mouseClick(console.preflight.pills[1], LEFT)
    assert console.desk.isVisible(), "only the light of the device leads there"


def test_of_a_simulated_device_one_sentence_is_said(screens: Screens) -> None:
    console = screens.hear(opened(), ready(3))
    screens.press(KEY.Key_F3)
    assert console.device.simulated.isVisible() and console.device.simulated.text() == SIMULATED
    assert not console.device.figures.isVisible() and not console.device.health.isVisible()


def test_a_device_that_is_well_shows_all_that_its_board_and_link_tell(screens: Screens) -> None:
    console = on_bench(screens)
    texts = " | ".join(visible_texts(console.device))
    for what in (
        "All is well.", "four-brake", "B-7", "/dev/ttyACM0", "0.9.0, protocol 1", "ready: no current", "homed at",
        "6 channels, zeroed at", "34\u202f512 counts", "120.32°", "computed", "x 20.0 mm   y 380.0 mm",
        "5.0 N   x 3.0   y -4.0", "1.6 ms at best", "12 of 812\u202f357 samples", "+12 ppm", "± 35 µs", "never",
    ):  # fmt: skip
        assert what in texts, what


def test_what_is_not_known_is_a_dash_and_never_an_old_value(screens: Screens) -> None:
    console = on_bench(screens)
    screens.hear(told(status(problem="no sample for 200 ms", homed=False, counts=(), theta=())))
    assert {label.text() for label in console.device.sensors.values.values()} == {"–"}
    assert console.device.board.values["State"].text() == "not connected"
    screens.hear(told(status(homed=False)))
    sensors = console.device.sensors.values
    screens.hear(told(status(homed=False, tip=(math.nan, math.nan), hand_force=(math.nan, math.nan))))
    assert sensors["Hand force"].text() == sensors["Handle"].text() == "–"
    assert sensors["Joint A"].text() == "34\u202f512 counts"


@pytest.mark.parametrize(
    ("device", "says", "advises"),
    [
        (status(problem=cause("no-sample", ms=200)), "no sample for 200 ms", "cable"),
        (status(fault=cause("bad-encoder")), "an encoder's signal is bad", "plug"),
        (status(fault=cause("watchdog")), "no command for 50 ms", "close other programs"),
        (status(homed=False), "not homed", "Home the encoders"),
        (status(zeroed=False), "no zero", "Take the zero"),
    ],
)
def test_what_keeps_trials_from_starting_is_said_with_what_to_do(device, says: str, advises: str) -> None:
    first = not_well(device, Rates())[0]
    assert first.state == m.BAD and says in first.what and advises in first.advice


def test_every_fault_of_the_board_has_its_advice() -> None:
    for code in FAULT_CODES.values():
        assert not_well(status(fault=cause(code)), Rates())[0].advice == FAULTS[code].advice


@pytest.mark.parametrize(
    ("counter", "says"),
    [("lost", "lost"), ("frames_bad", "damaged"), ("late_commands", "late"), ("not_closed", "contradict"),
     ("refused", "refuses")],
)  # fmt: skip
def test_a_counter_that_rises_is_worth_a_word_and_an_old_count_is_not(counter: str, says: str) -> None:
    recent, quiet = Recent(), dict.fromkeys(counters_of(status().report), 0)
    recent.add(0.0, quiet)
    noisy = {**quiet, "samples": 990, counter: 9}
    (word,) = not_well(status(), recent.add(1.0, noisy))
    assert says in word.what and word.advice and word.state == m.CAUTION
    for second in range(2, 2 * int(RECENT_S)):
        noisy = {**noisy, "samples": noisy["samples"] + 1000}
        rates = recent.add(float(second), noisy)
    assert not_well(status(), rates) == []


@pytest.mark.parametrize(
    ("counted", "says"),
    [({"lost_links": 2}, ["lost twice"]), ({"lost_links": 3, "begun_anew": 2}, ["lost once", "anew twice"]),
     ({"lost_links": 1, "begun_anew": 1}, ["anew once"]), ({"board_time_back": 1}, ["time went back once"])],
)  # fmt: skip
def test_why_a_connection_was_cut_off_is_told_apart(counted: dict, says: list[str]) -> None:
    words = not_well(status(counted), Rates())
    assert len(words) == len(says) and all(told in word.what for told, word in zip(says, words, strict=True))
    assert all(word.advice for word in words)


def test_samples_are_counted_by_the_clock_of_who_counted_them(screens: Screens) -> None:
    page = on_bench(screens).device
    for second in range(1, 4):
        screens.hear(told(status({"samples": 812_345 + 1000 * second}), float(second)))
    assert page.sensors.values["Samples"].text() == "1000 a second"


def test_what_encoders_say_before_they_are_homed_is_no_contradiction(screens: Screens) -> None:
    page = on_bench(screens, status({"samples": 0}, homed=False)).device

    def hear(second: int, not_closed: int, homed: bool) -> str:
        report = {"samples": 1000 * second, "not_closed": not_closed}
        screens.hear(told(status(report, homed=homed), float(second)))
        return page.sentences[0].text()

    assert "not homed" in hear(1, 900, False)
    hear(2, 950, True)
    assert hear(3, 950, True) == "All is well."
    assert "contradict" in hear(4, 999, True)


def test_another_connection_counts_anew() -> None:
    recent = Recent()
    recent.add(0.0, {"samples": 5000, "frames_bad": 7})
    assert recent.add(1.0, {"samples": 100, "frames_bad": 0}) == Rates()
    assert recent.add(2.0, {"samples": 1100, "frames_bad": 0}).per_s("samples") == pytest.approx(1000.0)


def test_a_step_is_asked_for_with_what_to_do_before_it_is_taken(screens: Screens) -> None:
    page = on_bench(screens).device
    for button, step, says in (
        (page.home, m.HOME, "mm"), (page.zero, m.ZERO, "Let go"), (page.reconnect, m.CONNECT, "closed and made again")
    ):  # fmt: skip
        QTest.mouseClick(button, LEFT)
        assert screens.client.sent == [] and says in page.card.text.text()
        screens.press(KEY.Key_Escape)
        assert page.card is None and page.isVisible()
        QTest.mouseClick(button, LEFT)
        QTest.mouseClick(page.card.buttons[0], LEFT)
        assert screens.client.sent == [m.Rig(step)] and page.card is None
        screens.client.sent.clear()


def test_faults_are_reset_as_the_brakes_are_allowed(screens: Screens) -> None:
    page = on_bench(screens).device
    assert not page.reset.isEnabled()
    screens.hear(ready(3, checks=WELL, brakes_off="the board: no command for 50 ms"))
    QTest.mouseClick(page.reset, LEFT)
    assert screens.client.sent == [m.AllowBrakes()]


def test_without_a_session_no_step_is_taken_and_the_page_says_why(screens: Screens) -> None:
    console = screens.hear(opened("", **ON_BENCH), m.Snapshot(m.NO_SESSION, checks=NOT_ZEROED), told(status()))
    QTest.mouseClick(console.start_page.device, LEFT)
    page = console.device
    assert page.isVisible() and "Open a session first" in page.why.text()
    assert not any(button.isEnabled() for button in (page.home, page.zero, page.reconnect))


def test_a_trial_that_runs_is_not_covered_by_the_page(screens: Screens) -> None:
    console = on_bench(screens)
    screens.hear(running(3, checks=WELL))
    assert console.desk.isVisible()
    screens.press(KEY.Key_F3)
    assert console.desk.isVisible()


def test_under_the_page_nothing_is_confirmed_unseen(screens: Screens) -> None:
    card = m.Card("Make four-brake ready", "Let go of the handle, go on.")
    waits = ready(3, checks=NOT_ZEROED, stage=m.RERIG, card=card)
    console = screens.hear(opened(**ON_BENCH), waits, told(status(zeroed=False)))
    assert screens.press(KEY.Key_F3) == [] and console.device.isVisible()
    assert screens.press(KEY.Key_Space) == [] == screens.press(KEY.Key_Return)
    screens.press(KEY.Key_F3)
    assert screens.press(KEY.Key_Space) == [m.Confirm()]


def test_a_session_can_be_opened_on_a_device_that_its_first_steps_make_ready(screens: Screens) -> None:
    page = screens.hear(opened("", **ON_BENCH), m.Snapshot(m.NO_SESSION, checks=NOT_ZEROED)).start_page
    assert page.new.isEnabled() and not page.practice.isVisible() and page.device.isVisible()
    full = (*NOT_ZEROED[:3], m.Check("Disk", m.BAD, "12 MB free"), NOT_ZEROED[4])
    screens.hear(m.Snapshot(m.NO_SESSION, checks=full))
    assert not page.new.isEnabled() and "12 MB free" in page.why.text()
    screens.hear(opened(""), m.Snapshot(m.NO_SESSION, checks=GREEN))
    assert page.practice.isVisible() and not page.device.isVisible()


def test_a_gain_feels_the_encoders_as_far_as_their_steps_are_coarse() -> None:
    fine = quantisation(DEVICE, status(), PRESETS)
    coarse = quantisation(DEVICE, status({"counts_per_rev": [48_000, 48_000]}), PRESETS)
    assert fine is not None and coarse is not None
    assert coarse.step_m == pytest.approx(2.0 * fine.step_m) and coarse.force_N == pytest.approx(2.0 * fine.force_N)
    assert fine.gain == max(preset.value("gain_N_s_m") for preset in PRESETS.values())
    assert fine.force_N == pytest.approx(fine.gain * fine.noise_m_s)
    gentle = {
        number: preset._replace(values=tuple(0.001 * value for value in preset.values))
        for number, preset in PRESETS.items()
    }
    few = quantisation(DEVICE, status(), gentle)
    assert few is not None and fine.felt and not few.felt
    assert quantisation(DEVICE, status(homed=False), PRESETS) is None


@pytest.mark.parametrize("size", [(1280, 720), (1240, 660), (1920, 1080)])
@pytest.mark.parametrize("bad", [False, True])
def test_no_text_is_cut(screens: Screens, size: tuple[int, int], bad: bool) -> None:
    console = on_bench(screens)
    console.setMinimumSize(1, 1)
    console.resize(*size)
    if bad:
        frames = {"good": 9, "bad_cobs": 0, "bad_crc": 9, "too_long": 0, "resyncs": 3, "bytes": 10**9, "bad": 9}
        counts = {"lost": 10**6, "late_commands": 10**5, "not_closed": 10**5, "refused": 10**5, "frames": frames}
        device = status(counts, fault=cause("bad-encoder"), homed=False, zeroed=False)
        screens.hear(ready(3, checks=LOST, brakes_off="the board: an encoder's signal is bad"), told(device))
    settle(console)
    assert cut_texts(console) == []
