"""Protocol files: what they say is what is run, what they cannot say is refused in one sentence with file and key."""

import json
import re

import numpy as np
import pytest
from msgspec.structs import asdict, replace
from protocols import PAPER, changed, protocol_of, short

from core.device import SHIPPED_FOLDER
from core.files import InputError
from core.path import Arc, Polyline, Segment
from experiments.assumptions import Assumptions
from experiments.plan import make_plan, print_plan
from experiments.protocol import load_protocol, protocol_from_json, protocol_to_json, shipped_protocols


def test_the_papers_protocol_is_the_experiment_of_section_v():
    assert [device.name for device in PAPER.devices] == ["three-brake", "four-brake"]
    assert PAPER.paths == {1: Segment((-0.10, 0.40), (0.10, 0.40)), 2: Segment((-0.08, 0.26), (0.08, 0.42))}
    assert len(PAPER.controllers) == 5 and PAPER.blocks * PAPER.repetitions == 3
    assert len(make_plan(PAPER, "01")) == 60


@pytest.mark.parametrize("name", shipped_protocols())
def test_every_shipped_protocol_can_be_followed_by_its_devices_and_printed(name):
    protocol = load_protocol(name)
    assert protocol.name == name and protocol.assumed
    assert print_plan(protocol, "07").startswith(f"{name} protocol, participant 07: ")


def test_a_file_of_ones_own_needs_little_and_the_rest_has_its_default(tmp_path):
    (tmp_path / "mine.toml").write_text(
        'name = "mine"\ndevices = ["four-brake"]\n'
        '[[path]]\nkind = "arc"\ncentre_m = [0.0, 0.3]\nradius_m = 0.1\nfrom_deg = 150.0\nto_deg = 30.0\n'
        '[[path]]\nnumber = 7\nkind = "polyline"\npoints_m = [[-0.05, 0.35], [0.0, 0.4], [0.05, 0.35]]\n'
        '[[controller]]\nname = "free"\nkind = "none"\n'
        '[[controller]]\nname = "guide"\nkind = "proportional"\ngain_N_s_m = 300\n'
    )
    protocol = load_protocol(tmp_path / "mine.toml")
    assert isinstance(protocol.paths[1], Arc) and isinstance(protocol.paths[7], Polyline)
    assert [preset[1:3] for preset in protocol.controllers.values()] == [("none", ()), ("proportional", (0, 300))]
    assert (protocol.rules, protocol.seed, protocol.blocks, protocol.practice_trials) == ("settled", 1, 1, 0)
    assert protocol.breaks is protocol.cues is None and not protocol.blind and not protocol.paths_assumed
    assert protocol.trial == replace(PAPER.trial, assumptions=Assumptions())
    assert protocol.mouse == PAPER.mouse and protocol.participants == ()


@pytest.mark.parametrize(
    ("said", "assumed"),
    [("", False), ("measured", False), ("measured on 3 May", False), ("assumed", True), ("one end assumed", True)],
)
def test_provenance_takes_words_by_the_rule_of_devices_and_may_be_missing(said, assumed):
    protocol = protocol_of(changed(PAPER.text, provenance=f'"{said}"'))
    assert protocol.paths_assumed == assumed and protocol.provenance == said


def test_what_is_asked_for_stands_in_place_of_what_the_file_says():
    protocol = load_protocol(devices=["four-brake"], rules="literal", low_gain=500.0, seed=9)
    assert [device.name for device in protocol.devices] == ["four-brake"]
    assert (protocol.rules, protocol.seed) == ("literal", 9)
    gains = {number: preset.value("gain_N_s_m") for number, preset in protocol.controllers.items()}
    assert gains == {1: 0, 2: 0, 3: 0, 4: 10_000, 5: 500}  # the lowest gain alone
    assert "literal rules, low gain 500 N s/m" in protocol.note()


def test_a_protocol_comes_back_from_what_is_stored_of_it_without_its_files(tmp_path):
    device = tmp_path / "my-device.toml"
    text = (SHIPPED_FOLDER / "four-brake.toml").read_text().replace('"four-brake"', '"mine"', 1)
    text = re.sub(r"(inertia_beyond_kg = [0-9.]+)", r'\1, calibration = "gauges.csv"', text, count=1)
    device.write_text(text)
    gauges = np.arange(36.0).reshape(6, 6)
    np.savetxt(tmp_path / "gauges.csv", gauges, delimiter=",")
    (tmp_path / "mine.toml").write_text(changed(PAPER.text, devices='["my-device.toml"]', blocks="2"))
    protocol = load_protocol(tmp_path / "mine.toml", rules="literal", low_gain=500, seed=4)
    stored = protocol_to_json(protocol)
    device.unlink()
    (tmp_path / "gauges.csv").unlink()
    back = protocol_from_json(stored, "session.db")
    assert {**asdict(back), "devices": ()} == {**asdict(protocol), "devices": ()}
    assert [d.text for d in back.devices] == [text]
    assert np.array_equal(back.devices[0].calibration, gauges)
    without = json.loads(json.dumps(stored))
    del without["devices"][0]["calibration"]
    with pytest.raises(InputError, match="session.db: devices.mine.*gauges.csv is missing"):
        protocol_from_json(without, "session.db")
    assert make_plan(back, "01") == make_plan(protocol, "01")


REFUSED = {
    "no name": (PAPER.text.replace('name = "paper"\n', ""), "key name is missing"),
    "no paths": (re.sub(r"\[\[path\]\](.*\n)+?(?=\[\[controller)", "", PAPER.text), "path is missing"),
    "too many": (changed(PAPER.text, blocks="1000"), "at most 10000 trials, not 20000"),
    "name": (changed(PAPER.text, name='"a;b"'), "name must be plain text without ;"),
    "no controllers": (PAPER.text[: PAPER.text.index("[[controller]]")], "key controller is missing"),
    "rules": (changed(PAPER.text, rules='"loose"'), "rules must be one of settled, literal"),
    "same number": (PAPER.text.replace("number = 2", "number = 1", 1), "path: number 1 is used twice"),
    "same controller": (PAPER.text.replace('"SDOF with gap"', '"SDOF"'), "two controllers have the same name"),
    "kind of controller": (PAPER.text.replace('kind = "none"', 'kind = "magic"'), "kind must be one of none, sdof"),
    "gain left out": (PAPER.text.replace("gain_N_s_m = 500.0", ""), "controller 5: gain_N_s_m is required"),
    "gap of none": (PAPER.text.replace('kind = "none"', 'kind = "none"\ngap_m = 0.005'), "gap_m is not for 'none'"),
    "no length": (PAPER.text.replace("end_m = [0.10, 0.40]", "end_m = [-0.10, 0.40]"), "path 1.*"),
    "out of reach": (PAPER.text.replace("end_m = [0.10, 0.40]", "end_m = [0.60, 0.40]"), "three-brake.* path 1 "),
    "participant": (changed(PAPER.text, participants='["a b"]'), "value 1 of participants must be letters and digits"),
    "same participant": (changed(PAPER.text, participants='["01", "01"]'), "participants: .* twice"),
    "unknown device": (changed(PAPER.text, devices='["five-brake"]'), "devices: unknown device 'five-brake'"),
    "cues": (PAPER.text + "\n[cues]\ntoo_fast_s = 5.0\ntoo_slow_s = 2.0\n", "cues: too_fast_s .* must be shorter"),
    "form, unknown kind": (PAPER.text + '\n[form]\nage = "years"\n', "form.age must be one of number, text"),
    "form, name": (PAPER.text + '\n[form]\n"a b" = "text"\n', "form: 'a b' must be of letters"),
}


@pytest.mark.parametrize("text, says", REFUSED.values(), ids=REFUSED)
def test_what_a_protocol_cannot_say_is_refused_with_file_and_key(tmp_path, text, says):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=says) as refusal:
        load_protocol(path)
    assert str(path) in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_device_that_cannot_follow_a_path_is_named_by_its_file(tmp_path):
    text = (SHIPPED_FOLDER / "four-brake.toml").read_text()
    for old, new in (("0.2794", "0.15"), ("0.3048", "0.17"), ("com_m = 0.1397", "com_m = 0.07")):
        text = text.replace(old, new)
    (tmp_path / "small.toml").write_text(text)
    (tmp_path / "mine.toml").write_text(changed(PAPER.text, devices='["three-brake", "small.toml"]'))
    for refused in (
        lambda: load_protocol(tmp_path / "mine.toml"),
        lambda: load_protocol(devices=[tmp_path / "small.toml"]),
    ):
        with pytest.raises(InputError, match=re.escape(f"{tmp_path / 'small.toml'}: cannot follow path 1 of")):
            refused()


def test_an_arc_is_checked_along_its_bulge_not_only_at_its_ends():
    ends_inside = (
        '[[path]]\nnumber = 3\nkind = "arc"\ncentre_m = [0.0, 0.47]\nradius_m = 0.16\n'
        "from_deg = 200.0\nto_deg = -20.0\n"
    )
    text = PAPER.text.replace("[[controller]]", ends_inside + "[[controller]]", 1)
    with pytest.raises(InputError, match="cannot follow path 3"):
        protocol_of(text)


def test_without_a_proportional_controller_there_is_no_low_gain_to_set():
    text = re.sub(r"\[\[controller\]\].*\s*number = [45]\n(.+\n)+", "", PAPER.text)
    assert {preset.kind for preset in protocol_of(text).controllers.values()} == {"none", "sdof"}
    with pytest.raises(InputError, match="no low gain"):
        protocol_from_json({**protocol_to_json(PAPER), "text": text, "overrides": {"low_gain": 5.0}}, "mine.toml")


def listed(text: str) -> list[tuple[str, str]]:
    """(run, path) of the lines of trials."""
    return re.findall(r"^ +(\d+)  .*  path (\d)$", text, flags=re.MULTILINE)


def test_the_printed_plan_holds_every_trial_in_order_the_re_rig_and_the_breaks():
    text = changed(PAPER.text, practice_trials="2") + "\n[breaks]\nafter_trials = 12\nleast_s = 90.0\n"
    protocol = protocol_of(text)
    said = print_plan(protocol, "02")
    assert listed(said) == [(str(t.run), str(t.path)) for t in make_plan(protocol, "02")]
    four, three = said.index("\nfour-brake\n"), said.index("\nthree-brake\n")
    assert four < said.index("re-rig to three-brake") < three  # participant 2 begins with the other
    assert said.count("  practice\n") == 2 and "60 trials and 4 of practice" in said
    assert said.count("break of at least 90 s") == 4
    lines = said.splitlines()
    after = [lines[i - 1].split()[0] for i, line in enumerate(lines) if "-- break" in line]
    assert after == ["12", "24", "42", "54"]
    minutes = int(re.search(r"about (\d+) min", said)[1])
    longer = print_plan(protocol_of(changed(text, blocks="6")), "02")
    assert int(re.search(r"about (\d+) min", longer)[1]) - minutes == pytest.approx((60 * 15 + 4 * 90) / 60, abs=1.1)
    assert "assumed: 15 s a trial" in said and "after every 12 trials of a device, at least 90 s" in said
    each = print_plan(protocol_of(text.replace("after_trials = 12", "after_trials = 1")), "02")
    assert "after every trial of a device" in each


def test_the_plan_of_a_blind_protocol_shows_codes_and_that_of_a_single_controller_says_that_it_repeats():
    said = print_plan(replace(PAPER, blind=True), "01")
    plan = said[said.index("\nthree-brake\n") :]
    assert re.findall(r"K[1-5]", plan) and not any(preset.name in plan for preset in PAPER.controllers.values())
    text = re.sub(r"\[\[controller\]\].*\s*number = [1345]\n(.+\n)+", "", PAPER.text)
    assert "only one controller" in print_plan(protocol_of(text), "01")
    assert "only one controller" not in print_plan(PAPER, "01")


def test_times_and_radii_of_a_protocol_are_those_of_its_trials(tmp_path):
    from sessions import new_session, run_trials

    from experiments.store.recording import read_recording

    text = short(paths=1).text.replace("hold_s = 0.5", "hold_s = 0.25").replace("end_s = 0.3 ", "end_s = 0.1 ")
    session = new_session(tmp_path, protocol=protocol_of(text))
    run_trials(session, 1)
    recording = read_recording(session.folder / session.rows[0].recording)
    session.close()
    phases = recording.text("phase")
    assert (phases == "end").sum() == 100
    move = int((phases == "move").argmax())
    assert (phases[move - 250 : move] == "hold").all() and phases[move - 251] == "approach"
    late = text.replace("time_out_s = 30.0\n", "time_out_s = 0.2\n", 1)
    session = new_session(tmp_path / "late", protocol=protocol_of(late))
    run_trials(session, 1)
    assert session.rows[0].status == "timeout" and session.rows[0].value("duration_s") == pytest.approx(0.2, abs=0.002)
    session.close()
