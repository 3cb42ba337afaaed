"""`phd bring-up`: every mistake of a builder is found by its own step and by no other, and every end is zero current.

`python tests/experiments/test_bring_up.py docs/bring-up.md` writes the page.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from bring_up_bench import Bringing

from app.cli import main
from core.device import load_device
from core.device_file import Encoders
from core.files import InputError
from experiments.bring_up.bring_up import Result
from experiments.bring_up.record import (
    brake_steps,
    make_record,
    newest_record,
    problem_of,
    record_to_amend,
    state_of,
    write_record,
)
from experiments.bring_up.step import Finding
from experiments.bring_up.steps import second_hole, with_needs
from experiments.identify.step_response import read_steps
from experiments.protocol import home_of, load_protocol
from hardware.emulated_board.builder import MISTAKES
from hardware.sensing.encoders import PoseSensing
from hardware.sensing.samples import sensing_of
from hardware.wire.frames import encode_frame
from hardware.wire.messages import Stop, pack

PAGE = Path(__file__).resolve().parents[2] / "docs" / "bring-up.md"
FOUR = load_device("four-brake")
#: mistake -> the step that finds it
FOUND_BY = {
    "slow-clock": "board",
    "floating-encoder": "quiet",
    "amplifier-offset": "quiet",
    "swapped-encoders": "encoder A",
    "inverted-encoder": "encoder B",
    "dead-encoder": "encoder A",
    "coarse-encoder": "second hole",
    "noisy-force": "zero",
    "inverted-force-x": "push right",
    "inverted-force-y": "push away",
    "turned-force": "push right",
    "weak-amplifier": "currents",
    "dead-amplifier": "currents",
    "slow-current": "currents",
    "ringing-current": "currents",
    "swapped-sensing": "currents",
    "dead-watchdog": "watchdog",
    "stop-not-wired": "stop",
    "stop-misses-B": "stop",
    "crossed-brakes": "brakes",
    "slipping-brake": "brakes",
    "lossy-line": "latency",
    "stuttering-line": "latency",
}


def failed(results: list[Result]) -> list[Result]:
    return [result for result in results if state_of(result) == "failed"]


@pytest.fixture(scope="module")
def whole() -> Bringing:
    """A bring-up without a mistake."""
    bringing = Bringing(FOUR)
    bringing.run()
    return bringing


def test_a_good_board_passes_every_step(whole: Bringing) -> None:
    assert [state_of(result) for result in whole.builder.results] == ["passed"] * len(whole.steps)
    assert not any(whole.bench.board.currents)
    stop = next(result.finding for result in whole.builder.results if result.step.name == "stop")
    assert stop.figures == {"reported": True} and "the board reports the stop" in stop.saw


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_found_by_its_own_step_and_only_there(mistake: str) -> None:
    bringing = Bringing(FOUR, mistake)
    found = failed(bringing.run())
    assert [result.step.name for result in found] == [FOUND_BY[mistake]]
    assert found[0].finding.advice
    assert f"| {MISTAKES[mistake].words} | {found[0].step.title} | {found[0].finding.advice} |" in PAGE.read_text()
    assert not any(bringing.bench.board.currents)


def test_a_board_with_three_brakes_and_encoders_at_the_elbows_passes_as_well() -> None:
    three = load_device("three-brake")
    assert three.sensing
    four = msgspec.structs.replace(three.sensing, encoders=Encoders(A=96000, E=48000, B=96000, C=48000))
    results = Bringing(replace(three, sensing=four)).run()
    assert not failed(results) and {"encoder E", "encoder C"} < {result.step.name for result in results}


def test_no_hand_is_asked_to_a_braked_handle_before_watchdog_and_stop_have_passed(whole: Bringing) -> None:
    """And no current flows before every step without one has been tried; more than 10 % never flows."""
    braking = [step for step in whole.steps if any(step.drive(0.1, FOUR.brakes.current_max))]
    first = whole.steps.index(braking[0])
    assert all("touch" in step.ask or "stop" in step.ask for step in braking if step.name != "brakes")
    assert {"watchdog", "stop", "supply back", "second hole"} < set(braking[-1].needs)
    assert not {step.name for step in whole.steps[:first]} & {step.name for step in braking}
    most = 0.1 * FOUR.brakes.current_max.max() + 1e-12
    assert max(max(step.drive(t / 50, FOUR.brakes.current_max)) for step in braking for t in range(1500)) <= most


@pytest.mark.parametrize("how", ["interrupted", "unplugged", "idle"])
def test_every_end_is_zero_current(how: str) -> None:
    """Ctrl+C, an unplugged cable, a builder who does nothing: in the step in which all brakes have current."""
    bringing = Bringing(FOUR, idle="stop")
    names = ("board", "quiet", "currents", "stop")
    bringing.steps = bringing.runner_steps(names)
    before = bringing.bench.tick
    flowing = 0

    def tick() -> bytes:
        nonlocal flowing
        flowing += all(bringing.bench.board.currents)
        if flowing == 300 and how == "interrupted":
            raise KeyboardInterrupt
        if flowing == 300 and how == "unplugged":
            flowing += 1
            bringing.bench.fault("unplug")
        return before()

    bringing.bench.tick = tick
    if how == "interrupted":
        with pytest.raises(KeyboardInterrupt):
            bringing.run()
    else:
        assert [result.step.name for result in failed(bringing.run())] == ["stop"]
    assert flowing >= 300
    bringing.bench.tick = before
    for _ in range(60):
        before()
    assert not any(bringing.bench.board.currents)


def test_a_firmware_that_latches_the_emergency_stop_passes_too() -> None:
    """As that of hardware/firmware does: the fault stands until the stop is released and the host resets it."""
    bringing = Bringing(FOUR)
    bringing.steps = bringing.runner_steps(("quiet", "currents", "stop", "supply back"))
    bench, before = bringing.bench, bringing.bench.tick

    def tick() -> bytes:
        if not bench.hand.supply:
            bench.board.receive(encode_frame(pack(Stop())), 1000 * bench.ticks)
        return before()

    bench.tick = tick
    assert [state_of(result) for result in bringing.run()] == ["passed"] * 4


def test_the_record_is_sealed_and_the_newest_is_named(whole: Bringing, tmp_path: Path) -> None:
    results, about = whole.builder.results, whole.link.report()
    about |= {"board": "TEST", "firmware": "1.0.0"}
    assert problem_of(newest_record(tmp_path, "TEST"), "1.0.0").startswith("This board was never")
    bad = [results[0]._replace(finding=results[0].finding._replace(passed=False)), *results[1:]]
    write_record(tmp_path, make_record(bad, FOUR, about, "A. Builder", "2026-01-01T00:00:00.000+00:00"), {})
    assert problem_of(newest_record(tmp_path, "TEST"), "1.0.0").startswith("Not every step")
    good = make_record(results, FOUR, about, "A. Builder", "2026-01-02T00:00:00.000+00:00")
    files = write_record(tmp_path, good, brake_steps(results))
    found = newest_record(tmp_path, "TEST")
    assert found and found.by == "A. Builder" and found.passed and problem_of(found, "1.0.0") == ""
    assert "1.1.0" in problem_of(found, "1.1.0")
    assert newest_record(tmp_path, "OTHER") is None
    assert all(len(read_steps(file)) for file in files[1:]) and len(files) > 1  # as phd identify reads them
    files[0].write_text(files[0].read_text().replace('"passed": true', '"passed": false', 1))
    with pytest.raises(InputError, match="checksum"):
        newest_record(tmp_path, "TEST")


def test_phd_identify_reads_from_the_same_steps_what_one_current_shows(
    whole: Bringing, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """The true numbers are the model's: of the torque within 30 %, of a time constant within a factor of 2."""
    brakes = next(result for result in whole.builder.results if result.step.name == "brakes").finding.figures
    for joint, text in brake_steps(whole.builder.results).items():
        file = tmp_path / f"{joint}.csv"
        file.write_text(text)
        assert main(["identify", str(file), "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        added, rise, fall = said["numbers"]
        recorded = [number["value"] for number in brakes[joint]["identified"]]
        assert [number["value"] for number in said["numbers"]] == pytest.approx(recorded, rel=0.01)
        assert "knee_A" in " ".join(said["not_seen"])
        assert added["value"] == pytest.approx(brakes[joint]["model_N_m"], rel=0.3)
        assert 0.5 < rise["value"] / brakes[joint]["model_rise_s"] < 2.0 and 0.01 < fall["value"] < 0.05
        assert main(["identify", str(file), "--out", str(tmp_path / "brake.toml")]) == 2
        assert "without --out" in capsys.readouterr().err and not (tmp_path / "brake.toml").exists()


def test_a_step_is_repeated_with_those_that_it_needs_and_the_record_takes_its_result(
    whole: Bringing, tmp_path: Path
) -> None:
    steps, results = whole.steps, list(whole.builder.results)
    names = [step.name for step in with_needs(steps, "supply back")]
    assert names == ["quiet", "currents", "stop", "supply back"]
    assert [step.name for step in with_needs(steps, "brakes")] == [step.name for step in steps][1:-1], "all but two"
    with pytest.raises(InputError, match="no step 'encoder E'; its steps are board, quiet"):
        with_needs(steps, "encoder E")
    about = whole.link.report() | {"board": "TEST", "firmware": "1.0.0"}
    with pytest.raises(InputError, match="no record of this board"):
        record_to_amend(tmp_path, FOUR, about)
    stop = [step.name for step in steps].index("stop")
    results[stop] = results[stop]._replace(finding=Finding(False, "every brake keeps its current"))
    first = make_record(results, FOUR, about, "A. Builder", "2026-01-01T00:00:00.000+00:00")
    write_record(tmp_path, first, {})
    again = [result for result in whole.builder.results if result.step.name in names]
    later = "2026-01-02T00:00:00.000+00:00"
    second = make_record(again, FOUR, about, "B. Builder", later, record_to_amend(tmp_path, FOUR, about))
    assert not first["passed"] and second["passed"]
    assert [step["name"] for step in second["steps"]] == [step.name for step in steps]
    assert [step["name"] for step in second["steps"] if (step["time"], step["by"]) == (later, "B. Builder")] == names
    with pytest.raises(InputError, match=r"firmware 1\.0\.0, not 1\.1\.0"):
        record_to_amend(tmp_path, FOUR, about | {"firmware": "1.1.0"})


def test_the_drawing_of_the_jig_has_the_numbers_of_the_device_files() -> None:
    drawing = (PAGE.parent / "homing-jig.svg").read_text()
    for name in ("four-brake", "three-brake"):
        device = load_device(name)
        home = home_of(device, load_protocol().paths)
        hole = second_hole(device, home)
        assert home == (0.0, 0.4) and hole == (0.0, pytest.approx(0.48))
        counts_per_rev = sensing_of(device)[0].counts
        sensing = PoseSensing(device, (0, 2), counts_per_rev)
        for place in (home, hole):
            for count in sensing.counts_at(place)[::2]:
                assert f"{count:,}" in drawing


HEAD = """# Bringing a board up

`phd bring-up --link serial:PORT --device NAME --by "YOUR NAME"` checks a device that has just been wired, one thing
after another: it says what to do, watches, says what it saw, and where a step fails what to mend. Nothing has to be
typed but Enter where it says so. The first steps need neither hand nor current. Brakes then get at most 10 % of their
current, with no hand at the handle; the only step with a hand at a braked handle comes last and is done only after
watchdog and emergency stop have passed. Ctrl+C, a failed step, an unplugged cable: every end is zero current.

A step whose conditions have not passed is not done ("needs" below), so that a mistake is found where it is and not
three steps later. After mending run the verb again, which begins anew, or with `--step NAME` (names: below) that step
alone, with those that it needs; its result goes into the newest record of the board.

The record, `DATA/bring-up/BOARD-TIME.json`, holds what each step saw, when and signed by whom, and carries a checksum;
a session on that board writes into its journal which record it names, or why none holds (never brought up, a step
failed, another firmware). The steps of the brakes lie beside it as files that `phd identify` reads: the time constants
of the record are found from them by its own fit: the torque that 10 % add, and a time constant each way. It says what
steps to one current do not show; a brake file takes steps to four currents at three speeds.

The device page of the app (F3, *Bring up …*) leads through the same steps while a session on that device is open,
between two trials; its record is the same.

To see it without a board: `phd emulate --hand builder`, in a second terminal `phd bring-up --link serial:PORT --by
ME` with the port that the first line names. `--mistake NAME` of `phd emulate` puts in one of the mistakes below.

## The steps

This table and the next are written by `python tests/experiments/test_bring_up.py docs/bring-up.md`, in simulated
time. The limits are our choice, in `experiments/bring_up/checks.py`.

"""
MIDDLE = """
*Brakes* needs every step before it. With the hand moving in circles, least squares over the friction of all joints
gives the torque that each brake's current adds at each joint. On the emulated board, whose brakes are the model,
single steps of 10 % come out between {low:.0f} and {high:.0f} % of the model's torque in this run: enough to tell
which brake it is, and no calibration. What `phd identify` reads from its few single steps is rougher: {added} % of the
model's torque, {rise} of its time constant when the current rises. Latency is watched for 60 s; in the run of the
tables for 1 s.

## What builders get wrong, and the step that finds it

In each row one mistake is made on the emulated board. All other steps pass, or are not done for want of the one that
failed.

| mistake | found by | advice |
|---|---|---|
"""


def spread(values: list[float], form: str) -> str:
    return f"{min(values):{form}} to {max(values):{form}}"


def page() -> str:
    """The page, from a run of all mistakes."""
    whole = Bringing(FOUR)
    results = whole.run()
    lines = ["| step | what you do | what flows | needs |", "|---|---|---|---|"]
    for result in results:
        step = result.step
        flows = "10 %" if any(any(step.drive(0.1 * n, FOUR.brakes.current_max)) for n in range(100)) else "nothing"
        needs = "every step before" if step.name == "brakes" else ", ".join(step.needs)
        lines.append(f"| **{step.name}**: {step.title} | {step.ask} | {flows} | {needs} |")
    brakes = next(result for result in results if result.step.name == "brakes").finding.figures
    shares = [100.0 * brakes[joint]["added_N_m"] / brakes[joint]["model_N_m"] for joint in "AEBC"]
    identified = [(brakes[joint], [number["value"] for number in brakes[joint]["identified"]]) for joint in "AEBC"]
    added = spread([100.0 * values[0] / about["model_N_m"] for about, values in identified], ".0f")
    rise = spread([values[1] / about["model_rise_s"] for about, values in identified], ".1f")
    rows = []
    for mistake, about in MISTAKES.items():
        found, *others = failed(Bringing(FOUR, mistake).run())
        assert not others, (mistake, found, others)
        rows.append(f"| {about.words} | {found.step.title} | {found.finding.advice} |")
        print(rows[-1], file=sys.stderr)
    middle = MIDDLE.format(low=min(shares), high=max(shares), added=added, rise=rise)
    return HEAD + "\n".join(lines) + "\n" + middle + "\n".join(rows) + "\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page())
