"""The signed record of a bring-up: a sealed file in the data folder, by the board's number, which sessions name."""

import re
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from core.device import Device
from core.files import InputError
from experiments.bring_up.bring_up import Result
from experiments.recording.atomic_files import write_new_files
from experiments.session.checksums import CHECKSUM, read_sealed, sealed

FOLDER = "bring-up"  # in the data folder; no participant's name begins so (sub-..)
FORMAT = 1
Record: TypeAlias = dict[str, Any]  # as JSON holds it


class RecordSummary(NamedTuple):
    """A record as a session names it."""

    file: str  # relative to the data folder
    checksum: str  # as in the file
    by: str
    time: str  # ISO, UTC
    passed: bool
    firmware: str
    steps: dict[str, str]  # title -> "passed", "failed", "not done"


def state_of(result: Result) -> str:
    """The state of a step: "passed", "failed" or "not done"."""
    return "passed" if result.finding.passed else "failed" if result.done else "not done"


def make_record(
    results: list[Result], device: Device, about: Record, by: str, time: str, before: Record | None = None
) -> Record:
    """The record of a bring-up, as JSON holds it. about: the device's report at the end.

    before: an earlier record, in which the steps that were done take the places of theirs.
    """
    found = [
        {
            "name": result.step.name, "title": result.step.title, "time": time, "by": by,
            "asked": result.step.ask, "state": state_of(result), "saw": result.finding.saw,
            "advice": result.finding.advice, "took_s": round(result.took_s, 1),
            "figures": {key: value for key, value in result.finding.figures.items() if key != "steps"},
        }
        for result in results
    ]  # fmt: skip
    anew = {step["name"]: step for step in found if not before or step["state"] != "not done"}
    steps = [anew.pop(step["name"], step) for step in before["steps"]] if before else []
    steps += anew.values()
    known = {key: about.get(key) for key in ("board", "firmware", "protocol", "starts", "counts_per_rev")}
    return {
        "format": FORMAT, "time": time, "signed_by": by, "device": device.name, **known,
        "current_limits_A": [float(most) for most in device.brakes.current_max],
        "passed": all(step["state"] == "passed" for step in steps), "steps": steps,
    }  # fmt: skip


def brake_steps(results: list[Result]) -> dict[str, str]:
    """Joint -> the current steps of its brake, as `phd identify` reads them."""
    found = [result.finding.figures["steps"] for result in results if "steps" in result.finding.figures]
    return {joint: text for steps in found for joint, text in steps.items() if text}


def write_record(data_dir: Path, record: dict[str, Any], steps: dict[str, str]) -> list[Path]:
    """Write the record, and beside it the brakes' current steps; the files. InputError: they cannot be written."""
    stamp = re.sub(r"\D", "", record["time"])[:17]  # ms
    name = f"{_plain(record['board'])}-{stamp}"
    files = {data_dir / FOLDER / f"{name}.json": sealed(record)}
    files |= {data_dir / FOLDER / f"{name}-steps-{joint}.csv": text.encode() for joint, text in steps.items()}
    write_new_files(files)
    return list(files)


def _plain(board: str | None) -> str:
    return re.sub(r"[^A-Za-z0-9_.]", "_", board or "") or "board"


def newest_record_file(data_dir: Path, board: str) -> tuple[Path, Record] | None:
    """The newest record of a board, its file and its content; None: there is none. InputError: it was damaged."""
    found = [(file, read_sealed(file)) for file in (data_dir / FOLDER).glob(f"{_plain(board)}-*.json")]
    own = ((file, about) for file, about in found if about.get("board") == board)
    return max(own, key=lambda written: written[1]["time"], default=None)


def newest_record(data_dir: Path, board: str) -> RecordSummary | None:
    """The newest record of a board as a session names it; None: there is none. InputError: it was damaged."""
    if (newest := newest_record_file(data_dir, board)) is None:
        return None
    file, about = newest
    try:
        return RecordSummary(
            f"{FOLDER}/{file.name}", about[CHECKSUM], about["signed_by"], about["time"], about["passed"],
            about.get("firmware") or "", {step["title"]: step["state"] for step in about["steps"]},
        )  # fmt: skip
    except (KeyError, TypeError) as error:
        raise InputError(f"{file}: is no record of a bring-up ({error})") from None


def record_to_amend(data_dir: Path, device: Device, about: Record) -> Record:
    """The record that a repeated step goes into. InputError: this board has none for this device and firmware."""
    newest = newest_record_file(data_dir, about.get("board") or "")
    if newest is None:
        raise InputError(f"--step: {data_dir} has no record of this board; run phd bring-up without --step first")
    file, before = newest
    for key, now in (("device", device.name), ("firmware", about.get("firmware"))):
        if before.get(key) != now:
            raise InputError(
                f"--step: {file} is of {key} {before.get(key)}, not {now}; run phd bring-up without --step"
            )
    return before


def problem_of(record: RecordSummary | None, firmware: str) -> str:
    """Why a board cannot be taken for brought up, one sentence; "": it can."""
    if record is None:
        return "This board was never brought up: run phd bring-up."
    if not record.passed:
        return "Not every step of the last bring-up has passed: run phd bring-up again."
    if record.firmware != firmware:
        return f"Firmware {record.firmware} was brought up, the board has {firmware}: run phd bring-up again."
    return ""
