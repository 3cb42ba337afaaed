"""Six-axis devices: recorded reports of both layouts, draining, bias, unplug and replug, by a device that is played."""

import time

import pytest
from hid_bus import NAVIGATOR, Bus
from waiting import wait_until

from core.files import InputError
from hardware.hid import AXES, BIAS_S, FORCE_FULL_N, SILENT_S, HidHand, attached, decode

COMPACT = {**NAVIGATOR, "product_id": 0xC635, "vendor_id": 0x256F, "product_string": "SpaceMouse Compact"}
WIRELESS = {**NAVIGATOR, "product_id": 0xC62E, "vendor_id": 0x256F, "product_string": "SpaceMouse Wireless"}

#: report as it comes from the bus, and the axes that it carries
GOLDEN = [
    (NAVIGATOR, "01 5e01 0000 0000", {"x": 350, "y": 0, "z": 0}),
    (NAVIGATOR, "01 a2fe 0a00 ffff", {"x": -350, "y": 10, "z": -1}),
    (NAVIGATOR, "02 0100 feff 5e01", {"rx": 1, "ry": -2, "rz": 350}),
    (COMPACT, "01 0000 a2fe 0000", {"x": 0, "y": -350, "z": 0}),
    (WIRELESS, "01 5e01 a2fe 0100 0200 fdff 0400", {"x": 350, "y": -350, "z": 1, "rx": 2, "ry": -3, "rz": 4}),
    (NAVIGATOR, "03 0100", {}),  # a button
    (NAVIGATOR, "17 64", {}),  # battery
    (NAVIGATOR, "01 5e01 00", {}),  # cut short
    (NAVIGATOR, "01 5e01 a2fe 0100 0200 fdff 0400", {}),  # the other layout's length
    (WIRELESS, "01 5e01 0000 0000", {}),
    (WIRELESS, "", {}),
]


@pytest.mark.parametrize("entry, report, axes", GOLDEN)
def test_recorded_reports_give_their_axes_and_leave_the_others_alone(entry, report, axes):
    counts = dict.fromkeys(AXES, 77)
    assert decode(attached([entry])[0].layout, bytes.fromhex(report), counts) == bool(axes)
    assert counts == dict.fromkeys(AXES, 77) | axes


def test_a_keyboard_or_an_unknown_device_is_not_taken_for_a_hand():
    keyboard = {**NAVIGATOR, "usage": 6}
    unknown = {**NAVIGATOR, "product_id": 0xC641, "vendor_id": 0x256F}
    assert attached([keyboard, unknown]) == []
    assert [found.product for found in attached([keyboard, NAVIGATOR, NAVIGATOR])] == ["SpaceNavigator"]


@pytest.fixture
def bus():
    return Bus()


@pytest.fixture
def hand(bus):
    hand = HidHand(listing=bus.listing, opening=bus.opening, clock=lambda: bus.now)
    yield hand
    hand.close()
    assert bus.closed == bus.opened  # whatever happened, nothing stays open


def test_full_deflection_to_the_right_and_away_is_the_full_force_to_the_right_and_away(bus, hand):
    bus.push("01 5e01 a2fe 0000")  # y is counted towards the person
    wait_until(lambda: hand.read().reports == 1)
    assert hand.read()[:2] == pytest.approx((FORCE_FULL_N, FORCE_FULL_N))
    assert "not a force sensor" in hand.read().text


@pytest.mark.parametrize("count", [0x7FFF, -0x8000, 351, 3000])
def test_a_garbage_report_pushes_no_harder_than_full_deflection_and_is_said(bus, hand, count):
    bus.push("01" + count.to_bytes(2, "little", signed=True).hex() * 3)
    wait_until(lambda: hand.read().reports == 1)
    reading, full = hand.read(), FORCE_FULL_N if count > 0 else -FORCE_FULL_N
    assert reading[:2] == pytest.approx((full, -full))
    assert f"reports beyond full deflection: 1, held at {FORCE_FULL_N:g} N" in reading.text
    bus.push("01 5e01 a2fe 0000")
    wait_until(lambda: hand.read().reports == 2)
    assert "beyond full deflection: 1," in hand.read().text


def test_only_the_newest_of_many_waiting_reports_counts(bus, hand):
    bus.push(*["01 0a00 0000 0000", "02 0100 0100 0100"] * 500, "01 5e01 0000 0000")
    wait_until(lambda: hand.read().reports == 1001)
    assert hand.read().fx_N == pytest.approx(FORCE_FULL_N)


def test_a_small_offset_at_the_start_is_taken_off(bus, hand):
    bus.push("01 0a00 f6ff 0000")
    wait_until(lambda: hand.read().reports == 1)
    assert hand.read().fx_N != 0.0
    bus.now = BIAS_S
    bus.push("01 0a00 f6ff 0000")
    wait_until(lambda: hand.read().reports == 2 and hand.read()[:2] == (0.0, 0.0))
    bus.push("01 6801 f6ff 0000")
    wait_until(lambda: hand.read().fx_N == pytest.approx(FORCE_FULL_N))


def test_a_device_that_falls_silent_while_deflected_lets_go(bus, hand):
    bus.push("01 5e01 0000 0000")
    wait_until(lambda: hand.read().reports == 1)
    bus.now += 0.9 * SILENT_S
    assert hand.read().fx_N > 0.0
    bus.now += 0.2 * SILENT_S
    assert hand.read()[:2] == (0.0, 0.0)


def biased(bus, hand) -> None:
    """It has said 10 counts for long enough."""
    bus.now += BIAS_S
    bus.push("01 0a00 0000 0000")
    wait_until(lambda: "taken off" in hand.read().text and hand.read().fx_N == 0.0)


def replugged(bus, hand, after: float = 2 * BIAS_S) -> None:
    """Out, and in again with a hand on the cap; long enough for a zero to be taken."""
    bus.plugged = False
    wait_until(lambda: not hand.read().connected)
    assert hand.read()[:2] == (0.0, 0.0) and "unplugged" in hand.read().text
    bus.plugged = True
    wait_until(lambda: hand.read().connected)
    for _ in range(3):
        came = hand.read().reports
        bus.push("01 4500 0000 0000")  # a fifth of full scale, less one
        wait_until(lambda came=came: hand.read().reports == came + 1)
        bus.now += after / 2
        time.sleep(0.03)  # its thread looks at the time after each wait for a report


def test_a_device_that_is_plugged_in_again_keeps_its_zero_whoever_pushes_it(bus, hand):
    biased(bus, hand)
    assert "0.6 N taken off" in hand.read().text
    replugged(bus, hand)
    bus.push("01 0a00 0000 0000")
    wait_until(lambda: hand.read().fx_N == 0.0)
    bus.push("01 6801 0000 0000")
    wait_until(lambda: hand.read().fx_N == pytest.approx(FORCE_FULL_N))


def test_a_cap_that_was_held_at_the_start_has_no_zero_after_a_replug_either(bus, hand):
    bus.push("01 5e01 0000 0000")
    wait_until(lambda: hand.read().reports == 1)
    assert not hand.take_bias()
    bus.now += BIAS_S
    time.sleep(0.05)
    replugged(bus, hand)
    bus.push("01 5e01 0000 0000")
    wait_until(lambda: hand.read().fx_N == pytest.approx(FORCE_FULL_N))


@pytest.mark.parametrize("other", [{"serial_number": "2"}, {"product_id": 0xC627}])
def test_another_device_takes_a_zero_of_its_own(bus, hand, other):
    biased(bus, hand)
    bus.plugged = False
    wait_until(lambda: not hand.read().connected)
    bus.entry = {**bus.entry, **other}
    bus.plugged = True
    wait_until(lambda: hand.read().connected)
    assert "taken off" not in hand.read().text
    bus.push("01 1e00 0000 0000")
    wait_until(lambda: hand.read().fx_N != 0.0)
    bus.now += BIAS_S
    bus.push("01 1e00 0000 0000")
    wait_until(lambda: "1.7 N taken off" in hand.read().text and hand.read().fx_N == 0.0)


def test_nothing_attached_or_nothing_allowed_is_one_sentence():
    with pytest.raises(InputError, match="no known six-axis device is attached"):
        HidHand(listing=lambda: [], opening=lambda path: None)

    def refused(path: bytes):
        raise OSError("open failed")

    with pytest.raises(InputError, match=r"SpaceNavigator \(046d:c626\) cannot be opened.*udev"):
        HidHand(listing=lambda: [NAVIGATOR], opening=refused)
