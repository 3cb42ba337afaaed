"""Device and brake files: what they mean; a device or brake that cannot exist is refused in one sentence."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from devices import stops_of
from hypothesis import given
from hypothesis import strategies as st

from core.device import build_device, load_device, shipped_devices
from core.device_file import SHIPPED_FOLDER as BRAKE_FOLDER
from core.device_file import parse_brake
from core.files import InputError
from core.mechanism import JOINTS
from core.workspace import free_tips, tip_is_free

FOUR = load_device("four-brake")
THREE = load_device("three-brake")
BRAKE = (BRAKE_FOLDER / "mrb-2107-3.toml").read_text()


def changed(text: str, *changes: tuple[str, str]) -> str:
    """The text with each pattern, which must occur, replaced."""
    for pattern, replacement in changes:
        assert re.search(pattern, text), pattern
        text = re.sub(pattern, replacement, text)
    return text


def device(*changes: tuple[str, str], brake: str = BRAKE):
    """The four-brake device with changes to its text."""
    return build_device(changed(FOUR.text, *changes), {"mrb-2107-3": brake}, "my.toml")


LINK = r"= \{mass_kg = 0.30, com_m = \S+ inertia_kg_m2 = \S+\}"


def test_shipped_devices_are_the_papers_and_those_it_names_and_say_that_they_are_assumed():
    shipped = {name: load_device(name) for name in shipped_devices()}
    assert {name: device.braked for name, device in shipped.items()}.items() >= {
        "er-two-brake": "AB", "four-brake": "AEBC", "pter": "AEBC", "three-brake": "AEB",
    }.items()  # fmt: skip
    assert all(device.assumed for device in shipped.values())


def test_a_coupling_takes_the_place_of_an_elbow_brake_and_is_shown_by_what_it_couples():
    pter = load_device("pter")
    assert pter.labels == {"A": "A", "E": "A-B", "B": "B", "C": "A+B"}
    assert THREE.labels == {"A": "A", "E": "E", "B": "B"}
    assert (pter.mechanism.arm_1.rotor, pter.mechanism.coupling) == (0.0, 0.0)
    changes = (r"(?m)^E = \{.*", "E = {B = 3.0}"), (r"(?m)^C = \{.*", "C = {A = -2.0, B = 1.0}")
    other = build_device(changed(pter.text, *changes), {"mrb-2107-3": BRAKE}, "my.toml")
    assert (other.labels["E"], other.labels["C"]) == ("3B", "-2A+B")


BAD_COUPLINGS = {
    "no brake": ("C = {A = 1.0, B = 1.0}", '(?m)^C = "mrb.*\n', "couplings.C: there is no brake C in brakes"),
    "fraction": ("E = {A = 0.5, B = 1.0}", "", r"couplings.E: .*whole numbers A and B, not both 0, not 0.5 and 1"),
    "nothing": ("E = {}", "", r"couplings.E: .*not both 0, not 0 and 0"),
    "gears": ("E = {A = 40.0}", "", "couplings.E.A must be at most 12"),
}


@pytest.mark.parametrize("line, gone, says", BAD_COUPLINGS.values(), ids=BAD_COUPLINGS)
def test_a_coupling_that_cannot_be_is_refused(line, gone, says):
    with pytest.raises(InputError, match=says):
        device(*([(gone, "")] if gone else []), (r"\Z", f"[couplings]\n{line}\n"))


def test_every_brake_can_exert_the_normalised_force_wherever_the_tip_can_be():
    from core.linkage import tip_force_map
    from core.simulator.state import pack_mechanism

    assert THREE.force_normalised_N == pytest.approx(17.4, abs=0.05)  # the paper's
    assert FOUR.force_normalised_N == pytest.approx(19.0, abs=0.05)
    for dev in (THREE, FOUR, load_device("pter")):
        g, mechanism = np.zeros((4, 2)), pack_mechanism(dev.mechanism)[0]
        for x, y in free_tips(dev.mechanism)[::97]:
            tip_force_map(mechanism, x, y, g)
            for joint in dev.braked:
                assert 5.3 * np.hypot(*g[JOINTS.index(joint)]) >= dev.force_normalised_N * (1 - 1e-12)


def test_a_link_without_centre_and_inertia_is_a_uniform_rod():
    rods = device((LINK, "= {mass_kg = 0.30}")).mechanism
    arm = FOUR.mechanism.arm_1
    assert rods.arm_1.coupling == pytest.approx(0.30 * 0.5)
    rotor = 1e-4
    assert rods.arm_1.distal == pytest.approx(0.30 * arm.length_2**2 / 3 + rotor)
    carried = (1.4 + 0.30) * arm.length_1**2
    assert rods.arm_1.proximal == pytest.approx(0.30 * arm.length_1**2 / 3 + carried + 2 * rotor)


def test_what_a_device_file_may_leave_out_is_as_it_says():
    bare = device((r"(?s)\[limits\].*?\[brakes\]", "[brakes]"), (r"(?s)\[sensing\].*", ""))
    assert bare.mechanism.margin == 0.3 and not bare.mechanism.has_theta_stops
    assert bare.sensing is None
    m = device(("joint_._kg = 1.4", ""), ("rotor_inertia_kg_m2 = 1e-4", "")).mechanism
    assert m.arm_1.rotor == 0.0
    assert m.arm_1.proximal == pytest.approx(1.95e-3 + 0.30 * 0.1397**2 + 0.30 * 0.2794**2)
    odd = device(('(?m)^[AE] = "mrb-2107-3"\n', ""))
    assert odd.braked == "BC" and list(odd.brakes.present) == [0, 0, 1, 1]


def test_a_copied_device_file_is_as_good_as_the_shipped_name_and_a_brake_is_found_relative_to_it(tmp_path: Path):
    (tmp_path / "mine.toml").write_text(FOUR.text)
    assert load_device(tmp_path / "mine.toml").mechanism.arm_2 == FOUR.mechanism.arm_2
    assert load_device("mine.toml", tmp_path).name == "four-brake"
    (tmp_path / "brakes").mkdir()
    (tmp_path / "brakes" / "weak.toml").write_text(BRAKE.replace("current_max_A = 1.0", "current_max_A = 0.5"))
    (tmp_path / "mine.toml").write_text(changed(FOUR.text, ('A = "mrb-2107-3"', 'A = "brakes/weak.toml"')))
    mine = load_device(tmp_path / "mine.toml")
    assert list(mine.brakes.current_max) == [0.5, 1, 1, 1]
    assert set(mine.brake_texts) == {"brakes/weak.toml", "mrb-2107-3"}


@pytest.mark.parametrize("said", ["measured; tip mass assumed", "Assumed", "an assumption", "unknown", "", " ", None])
def test_a_number_that_is_assumed_or_of_unknown_origin_makes_the_device_assumed_in_the_device_and_a_brake(said):
    line = "" if said is None else f'provenance = "{said}"'
    measured = 'provenance = "measured on the bench"'
    own = 'provenance = "assumed"'
    assert device((own, line), brake=BRAKE.replace(own, measured)).assumed
    assert device((own, measured), brake=BRAKE.replace(own, line)).assumed
    assert not device((own, measured), brake=BRAKE.replace(own, measured)).assumed


def test_a_force_sensor_calibration_is_read_beside_the_device(tmp_path: Path):
    text = changed(FOUR.text, (r"inertia_beyond_kg = 0.1\}", 'inertia_beyond_kg = 0.1, calibration = "c.csv"}'))
    (tmp_path / "mine.toml").write_text(text)
    matrix = np.arange(36.0).reshape(6, 6)
    np.savetxt(tmp_path / "c.csv", matrix, delimiter=",")
    loaded = load_device(tmp_path / "mine.toml")
    assert loaded.calibration is not None and np.array_equal(loaded.calibration, matrix)
    again = build_device(loaded.text, loaded.brake_texts, "stored", loaded.calibration_text)
    assert again.calibration is not None and np.array_equal(again.calibration, matrix)
    with pytest.raises(InputError, match="c.csv is missing"):
        build_device(loaded.text, loaded.brake_texts, "stored")
    (tmp_path / "c.csv").write_text("1,2\n3,4\n")
    with pytest.raises(InputError, match="6 x 6"):
        load_device(tmp_path / "mine.toml")


@given(st.floats(-0.7, 0.7), st.floats(0.001, 0.7), st.sampled_from(["three-brake", "four-brake"]))
def test_the_tip_is_free_exactly_where_no_hard_stop_is_passed(x, y, name):
    dev = {"three-brake": THREE, "four-brake": FOUR}[name]
    nearest = stops_of(dev, (x, y)).min()
    if abs(nearest) > 1e-9:
        assert bool(tip_is_free(dev.mechanism, x, y)) == (nearest > 0.0)
    free, stopped = np.array([0.0, 0.4]), np.array([x, y])
    for _ in range(40 * (nearest < 0.0)):  # to the stop on the way there
        middle = 0.5 * (free + stopped)
        free, stopped = (middle, stopped) if tip_is_free(dev.mechanism, *middle) else (free, middle)
    assert nearest > 0.0 or abs(stops_of(dev, free).min()) < 1e-9


BAD_DEVICES = {
    "arms too short": (r"0\.0762", "2.0", r"bases are 4 m apart, more than the arms reach.*L_AE_m"),
    "margin too wide": ("margin = 0.3 ", "margin = 0.9999 ", "no tip position.*margin of 0.9999"),
    "margin of one": ("margin = 0.3 ", "margin = 1.0 ", r"limits\.margin must be less than 1"),
    "stops leave nothing": (
        "margin = 0.3 ", "margin = 0.3\ntheta_E_rad = [0.1, 0.2]\n", "no tip position.*theta_E_rad"
    ),
    "stops reversed": ("margin = 0.3 ", "margin = 0.3\ntheta_E_rad = [1, -1]\n", "theta_E_rad must be .low, high"),
    "link without mass": ("AE = " + LINK[2:], "AE = {}", r"required key mass\.AE\.mass_kg is missing"),
    "no brake": (r'(?m)^[AEBC] = "mrb.*$', "", "at least one of the joints"),
    "three coordinates": (r"\[-0.0762, 0.0\]", "[0, 0, 0]", r"base_A_m must hold 2 values, not 3"),
    "elbows": ('"out"', '"up"', "elbows must be one of out, in, left, right, not 'up'"),
    "one encoder": ("A = 96000, B = 96000", "A = 96000", "two or four"),
    "encoder counts": ("A = 96000,", "A = 0.5,", r"sensing\.encoders\.A must be a whole number"),
    "sensor body": ('"handle"', '"table"', "on must be one of"),
    "sensor mass": ("beyond_kg = 0.1", "beyond_kg = 0.6", r"part of mass\.tip_kg"),
    "name for a folder": ('name = "four-brake"', 'name = "a/b"', "name must be plain text"),
}  # fmt: skip
BAD_IN_SEVERAL_LINES = {
    "arm cannot fold": (
        [("L_AE_m = 0.2794", "L_AE_m = 2.0"), ("L_ED_m = 0.3048", "L_ED_m = 0.3")],
        r"no tip position.*L_AE_m = 2, L_ED_m = 0\.3",
    ),
    "no mass at all": (
        [(LINK, "= {mass_kg = 0}"), ("tip_kg = 0.5", "tip_kg = 0"), ("joint_._kg = 1.4", ""),
         ("rotor_inertia_kg_m2 = 1e-4", ""), ("beyond_kg = 0.1", "beyond_kg = 0")],
        "mass: too little",
    ),
}  # fmt: skip
BAD = {name: ([(old, new)], says) for name, (old, new, says) in BAD_DEVICES.items()} | BAD_IN_SEVERAL_LINES


@pytest.mark.parametrize("changes, says", BAD.values(), ids=BAD)
def test_a_device_that_cannot_be_is_refused(changes, says):
    with pytest.raises(InputError, match=says) as refusal:
        device(*changes)
    assert str(refusal.value).startswith("my.toml: ") and "\n" not in str(refusal.value)


def test_an_unknown_device_is_named_with_those_that_exist_and_an_unknown_brake_with_the_file_that_asks(tmp_path: Path):
    with pytest.raises(InputError, match=f"unknown device 'five-brake'.*{', '.join(shipped_devices())}"):
        load_device("five-brake")
    with pytest.raises(InputError, match="unknown device"):
        load_device(tmp_path)
    for name in ("", "x" * 5000, "a\0b"):
        with pytest.raises(InputError, match="unknown device"):
            load_device(name)
    (tmp_path / "mine.toml").write_text(changed(FOUR.text, ('B = "mrb-2107-3"', 'B = "nope"')))
    with pytest.raises(InputError, match=r"mine\.toml: brakes: unknown brake 'nope'"):
        load_device(tmp_path / "mine.toml")


def test_a_theta_stop_means_the_same_in_every_turn():
    """A range across pi, and the same range a turn lower, allow the same tips; one just short of pi allows fewer."""

    def stopped(low: float, high: float):
        return device((r"margin = 0.3 ", f"margin = 0.3\ntheta_A_rad = [{low}, {high}]\n"))

    across, lower, short = stopped(1.6, 3.5), stopped(1.6 - 2 * math.pi, 3.5 - 2 * math.pi), stopped(1.6, 2.9)
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 41), np.linspace(0.02, 0.6, 41))
    allowed = tip_is_free(across.mechanism, x, y)
    np.testing.assert_array_equal(allowed, tip_is_free(lower.mechanism, x, y))
    assert 0 < tip_is_free(short.mechanism, x, y).sum() < allowed.sum()
    tips = np.column_stack((x[allowed], y[allowed]))[::25]
    np.testing.assert_allclose(stops_of(across, *tips), stops_of(lower, *tips), atol=1e-12)
    assert stops_of(across, *tips).min() >= -1e-12


BAD_BRAKES = {
    "negative off torque": ("0.35,", "-0.35,", "k gives a negative torque at zero current"),
    "falls below the knee": ("k = .3.25", "k = [-1", "must rise with the current"),
    "falls above the knee": (
        r"-1\.5625, 7\.25, -0\.3875",
        "-8.75, 7.25, -0.1",
        "must rise with the current up to",
    ),
    "negative time": (r"0\.066\]", "-0.066]", r"rise\.a gives a time constant of -"),
    "dips below zero at an end": (r"0\.002, 0\.002, 0\.038", "0.002, 0.002, 0.017", r"of -0\.001 s at 8 rpm and 0 A"),
    "dips below zero inside": (  # 0.002 (w - 1)^2 - 0.001 at no current
        r"0\.018, -0\.012, -0\.012, 0\.002, 0\.002, 0\.038",
        "0.002, -0.004, -0.004, 0.002, 0.002, 0.001",
        r"fall\.a gives a time constant of -0\.001 s at 2 rpm and 0 A",
    ),
    "no time above": ("a_avg_s = 0.030", "a_avg_s = 0", r"rise\.a_avg_s must be at least 1e-06"),
    "floor above omega_0": (r"floor_rpm = 0\.125", "floor_rpm = 9", "must not exceed omega_0_rpm"),
    "no unit": ("knee_A", 'command_unit = ""\nknee_A', "command_unit must be 1 to 12 characters of plain text"),
}


@pytest.mark.parametrize("pattern, replacement, says", BAD_BRAKES.values(), ids=BAD_BRAKES)
def test_a_brake_that_cannot_be_is_refused(pattern, replacement, says):
    with pytest.raises(InputError, match=says):
        parse_brake(changed(BRAKE, (pattern, replacement)), "my-brake.toml")


@given(st.floats(0.01, 20), st.floats(0, 5), st.floats(-30, 30), st.floats(-30, 30), st.floats(0.05, 0.9))
def test_an_accepted_brake_has_a_torque_that_rises_all_the_way(k1, k2, k3, k4, knee):
    k5 = k1 * knee + k2 - (k3 * knee + k4) * knee
    gain = (r"(?m)^k = .*$", f"k = [{k1}, {k2}, {k3}, {k4}, {k5}]")
    text = changed(BRAKE, gain, ("knee_A = 0.2", f"knee_A = {knee}"))
    currents = np.linspace(0.0, 1.0, 201)
    torque = np.where(currents < knee, k1 * currents + k2, (k3 * currents + k4) * currents + k5)
    rises = bool(np.all(np.diff(torque) > -1e-9))
    try:
        parse_brake(text, "brake")
        assert rises
    except InputError:
        slopes = 2 * k3 * np.array([knee, 1.0]) + k4
        assert slopes.min() <= 1e-9


def test_the_brakes_of_a_device_are_commanded_in_one_unit():
    assert (FOUR.command_unit, load_device("er-two-brake").command_unit) == ("A", "kV/mm")
    field = BRAKE.replace("\nk = ", '\ncommand_unit = "kV/mm"\nk = ', 1)
    with pytest.raises(InputError, match="commanded in one unit, not in A and kV/mm"):
        mixed = changed(FOUR.text, ('A = "mrb-2107-3"', 'A = "field"'))
        build_device(mixed, {"mrb-2107-3": BRAKE, "field": field}, "my.toml")


def test_the_tip_is_never_behind_the_bases():
    assert not tip_is_free(FOUR.mechanism, 0.0, -0.4) and not tip_is_free(THREE.mechanism, 0.0, 0.0)
