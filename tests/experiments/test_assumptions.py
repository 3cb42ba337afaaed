"""Assumptions: a file may change any of them; without the table nothing changes; a wrong one is one sentence."""

import pytest

from core.files import InputError
from experiments.assumptions import DEFAULTS, Assumptions
from experiments.protocol import SHIPPED_FOLDER, Protocol, load_protocol, protocol_from_json, protocol_to_json

PAPER = load_protocol()
TEXT = (SHIPPED_FOLDER / "paper.toml").read_text()


def assuming(lines: str) -> Protocol:
    """The paper's protocol with a table of assumptions."""
    about = protocol_to_json(PAPER)
    return protocol_from_json({**about, "text": f"{TEXT}\n[assumptions]\n{lines}\n"}, "mine.toml")


def test_without_the_table_everything_is_as_the_defaults_have_it():
    assert PAPER.assumptions == PAPER.trial.assumptions == DEFAULTS
    assert PAPER.note() == "paper protocol, settled rules, low gain 5 N s/m, parameters assumed"


def test_what_differs_from_the_defaults_stands_in_the_note_and_is_stored():
    protocol = assuming('sensing = "encoders"\nlag_factor = 3.0\nlow_gain = 120.0')
    assert protocol.note() == (
        "paper protocol, settled rules, low gain 120 N s/m, lag factor 3, sensing encoders, parameters assumed"
    )
    again = protocol_from_json(protocol_to_json(protocol), "stored")
    assert again.assumptions == protocol.assumptions == Assumptions(sensing="encoders", lag_factor=3.0, low_gain=120.0)


def test_the_command_lines_low_gain_stands_above_the_files():
    about = protocol_to_json(assuming("low_gain = 120.0"))
    asked = protocol_from_json({**about, "overrides": {"low_gain": 200.0}}, "stored")
    assert asked.low_gain == asked.assumptions.low_gain == 200.0
    assert asked.controllers[4] == PAPER.controllers[4]


WRONG = {
    "unknown key": ("friction = 1.0", "unknown key assumptions.friction"),
    "unknown word": ('fidelity = "best"', "assumptions.fidelity must be one of ideal, static, mr, not 'best'"),
    "negative": ("drag_factor = -1.0", "assumptions.drag_factor must be at least 0, not -1.0"),
    "no lag at all": ("lag_factor = 0.0", "assumptions.lag_factor must be greater than 0, not 0.0"),
    "infinite": ("lag_factor = inf", "assumptions.lag_factor must be finite"),
    "a word for a number": ('backlash_deg = "none"', "assumptions.backlash_deg must be a number, not text"),
    "a whole turn": ("backlash_deg = 360.0", "assumptions.backlash_deg must be less than 360, not 360.0"),
    "too long a filter": ("filter_samples = 64", "assumptions.filter_samples must be at most 63, not 64"),
    "low gain": ('low_gain = "low"', "assumptions.low_gain must be a number or \"no vibration\", not 'low'"),
    "no low gain": ("low_gain = 0.0", "assumptions.low_gain must be greater than 0, not 0.0"),
}


@pytest.mark.parametrize("lines, says", WRONG.values(), ids=WRONG)
def test_a_wrong_assumption_is_refused_in_one_sentence(lines, says):
    with pytest.raises(InputError) as refusal:
        assuming(lines)
    assert says in str(refusal.value) and "\n" not in str(refusal.value)
