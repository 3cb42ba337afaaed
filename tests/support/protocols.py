"""Protocols for tests: the paper's, and the paper's with some lines of its file changed."""

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path

from experiments.analysis.trials_table import StudyData, TrialRow, as_table
from experiments.protocol import Protocol, load_protocol, protocol_from_json, protocol_to_json
from experiments.trial.population import load_population

PAPER = load_protocol()
PEOPLE = load_population()
#: A protocol file of other paths than segments, on one device, with practice, breaks and feedback.
CURVES = Path(__file__).with_name("curves.toml")


def changed(text: str, **values: str) -> str:
    """The text of a protocol with other values of top-level keys, as they stand in TOML."""
    for key, value in values.items():
        line = f"{key} = {value}"
        text, count = re.subn(rf"^{key} = .*$", line, text, flags=re.MULTILINE)
        if not count:
            text = f"{line}\n{text}"
    return text


def assuming(lines: str, text: str = PAPER.text) -> str:
    """The text of a protocol with these lines in its table of assumptions."""
    return re.sub(r"(?<=^\[assumptions\]).*\n(.+\n)*", f"\n{lines}\n", text, count=1, flags=re.MULTILINE)


def protocol_of(text: str) -> Protocol:
    """The protocol of a text with those of the paper's devices that it names."""
    about, names = protocol_to_json(PAPER), tomllib.loads(text)["devices"]
    devices = [device for device in about["devices"] if device["name"] in names]
    return protocol_from_json({**about, "text": text, "devices": devices}, "test")


def short(blocks: int = 1, paths: int = 2, **values: str) -> Protocol:
    """The paper's with fewer blocks, and its first path alone if `paths` is 1: 10 trials a block and path."""
    text = changed(PAPER.text, blocks=str(blocks), **values)
    if paths == 1:
        text = re.sub(r"\[\[path\]\]\s*number = 2\n(.+\n)+", "", text)
    return protocol_of(text)


def study_data(rows: Sequence[TrialRow], note: str = "note", protocol: str = "paper") -> StudyData:
    """Trials of people by the paper's controllers, as figures and reports take them."""
    return StudyData(as_table(rows), PAPER.controllers, protocol, note, note, simulated=False)
