"""`phd bring-up`: every mistake of a builder is found by its own step and by no other, and every end is zero current.

`python tests/experiments/test_bring_up.py docs/bring-up.md` writes the page's tables and prints its figures.
"""

import json
import re
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
from experiments.bring_up.brakes_in_motion import TIMES
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
FOUR, THREE = load_device("four-brake"), load_device("three-brake")
THREE = replace(
    THREE,
    sensing=msgspec.structs.replace(THREE.sensing, encoders=Encoders(A=96000, E=48000, B=96000, C=48000)),
)
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

#: Of what shows in a current alone. The steps with a hand have none: those of one of them, weak-amplifier, are tried.
OF_CURRENTS = (
    "dead-amplifier", "slow-current", "ringing-current", "swapped-sensing", "dead-watchdog", "stop-not-wired",
    "stop-misses-B",
)  # fmt: skip
WITHOUT_HAND = ("board", "quiet", "currents", "watchdog", "stop", "supply back", "latency")


def failed(results: list[Result]) -> list[Result]:
    return [result for result in results if state_of(result) == "failed"]


@pytest.fixture(scope="module")
def whole() -> Bringing:
    """A bring-up without a mistake."""
    bringing = Bringing(FOUR, rounds=TIMES)
    bringing.run()
    return bringing


def test_a_good_board_passes_every_step(whole: Bringing) -> None:
    assert [state_of(result) for result in whole.builder.results] == ["passed"] * len(whole.steps)
    assert not any(whole.bench.board.currents)
    stop = next(result.finding for result in whole.builder.results if result.step.name == "stop")
    assert stop.figures == {"reported": True} and "the board reports the stop" in stop.saw


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_found_by_its_own_step_and_only_there(mistake: str) -> None:
    """One of them on a board with three brakes and encoders at the elbows, whose other steps pass as well."""
    bringing = Bringing(THREE if mistake == "stuttering-line" else FOUR, mistake)
    if mistake in OF_CURRENTS:
        bringing.steps = bringing.runner_steps(WITHOUT_HAND)
    results = bringing.run()
    (found,) = failed(results)
    assert found.step.name == FOUND_BY[mistake] and found.finding.advice
    assert f"| {MISTAKES[mistake].words} | {found.step.title} | {found.finding.advice} |" in PAGE.read_text()
    assert not any(bringing.bench.board.currents)
    if mistake == "stuttering-line":
        passed = {result.step.name for result in results if state_of(result) == "passed"}
        assert len(passed) == len(results) - 1 and {"encoder E", "encoder C"} < passed


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


STEPS, FOUND = "| step | what you do | what flows | needs |", "| mistake | found by | advice |"


def figures(results: list[Result]) -> str:
    """What the paragraph between the tables says of the brakes, least and most of all four."""
    brakes = next(result for result in results if result.step.name == "brakes").finding.figures
    shares = []
    for one in (brakes[joint] for joint in "AEBC"):
        added, rise, *_ = (number["value"] for number in one["identified"])
        shares.append((one["added_N_m"] / one["model_N_m"], added / one["model_N_m"], rise / one["model_rise_s"]))
    each = zip(
        ("torque in motion", "torque of steps", "time constant of steps"), zip(*shares, strict=True), strict=True
    )
    return "\n".join(f"{what}: {min(found):.2f} to {max(found):.2f} of the model's" for what, found in each)


def page(text: str, results: list[Result]) -> str:
    """The page with the tables of a run without a mistake, and of one with each."""
    rows: dict[str, list[str]] = {STEPS: [], FOUND: []}
    for step in (result.step for result in results):
        flows = "10 %" if any(any(step.drive(0.1 * n, FOUR.brakes.current_max)) for n in range(100)) else "nothing"
        needs = "every step before" if step.name == "brakes" else ", ".join(step.needs)
        rows[STEPS].append(f"| **{step.name}**: {step.title} | {step.ask} | {flows} | {needs} |")
    for mistake, about in MISTAKES.items():
        (found,) = failed(Bringing(FOUR, mistake).run())
        rows[FOUND].append(f"| {about.words} | {found.step.title} | {found.finding.advice} |")
    for header, lines in rows.items():
        line, *_ = re.findall(rf"^{re.escape(header)}\n(.*)\n", text, re.MULTILINE)
        table = "".join(f"{one}\n" for one in (header, line, *lines))
        text = re.sub(rf"{re.escape(header)}\n(\|.*\n)+", lambda _, table=table: table, text)
    return text


if __name__ == "__main__":
    good = Bringing(FOUR, rounds=TIMES).run()
    print(figures(good))
    Path(sys.argv[1]).write_text(page(Path(sys.argv[1]).read_text(), good))
