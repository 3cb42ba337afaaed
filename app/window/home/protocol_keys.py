"""The keys of a protocol that its editor shows in fields, line by line, and how a value is typed."""

import itertools
from collections.abc import Iterable, Mapping
from typing import Any

from app.window.widgets.fields import Field, LongText, NumberField, TextField, Tick
from app.window.widgets.parts import Segments
from core.control.rule_sets import RULE_SETS
from core.files import InputError
from experiments.language import shipped_languages
from experiments.protocol_file import FEEDBACK, Settings

DEFAULTS = Settings(name="")
TABLES = ("breaks", "trial", "questionnaire", "consent", "form")
LISTS = {"devices": str, "controller": dict, "path": dict, "instruction": dict}  # of such entries
PAGE_BREAK = "\n---\n"  # between the pages of instructions
MOST = 10_000  # letters of a field: a form, or the labels of many participants


def form_lines() -> dict[str, list[dict[str, Field]]]:
    """Heading of the form -> its lines -> one key of the file or two, each with its field."""
    consent = LongText("Consent", "What the participant agrees to before the form; empty: consent is not asked.")
    instruction = "What the participant reads first; a line of --- begins another page."
    approach = NumberField("Longest approach (s)", "of a simulated operator; a person has 10 minutes")
    return {
        "": [{"name": TextField("Name", most=MOST)}],
        "Trials": [
            {"blocks": NumberField("Blocks"), "repetitions": NumberField("Repetitions")},
            {"practice_trials": NumberField("Practice trials"), "seed": NumberField("Seed")},
            {
                "breaks.after_trials": NumberField("Break after trials"),
                "breaks.least_s": NumberField("Shortest break (s)"),
            },
            {"trial.time_out_s": NumberField("Longest move (s)"), "trial.approach_time_out_s": approach},
            {"rules": one_of("Rules", RULE_SETS), "blind": Tick("Blind: codes for controllers")},
        ],
        "People": [
            {"participants": TextField("Participants", "01, 02, 03; none named: anybody", MOST)},
            {"language": one_of("Language", shipped_languages()), "feedback": one_of("Feedback", FEEDBACK)},
            {"show_linkage": Tick("The linkage is shown"), "tones": Tick("Tones at “go” and at the end")},
            {"questionnaire.on": Tick("A questionnaire after each block")},
            {"consent.text": consent},
            {"form": TextField("Form", "handedness: right, left; age: number", MOST)},
            {"instruction": LongText("Instructions", instruction)},
        ],
    }


def one_of(label: str, choices: Iterable[str]) -> Segments:
    return Segments({choice: choice for choice in choices}, label)


def refuse_other_shapes(content: Mapping[str, Any]) -> None:
    """InputError where a file has something else in place of a table or a list that the form shows."""
    for key in TABLES:
        if not isinstance(content.get(key, {}), dict):
            raise InputError(f"{key} must be a table")
    for key, kind in LISTS.items():
        entries = content.get(key, [])
        if not isinstance(entries, list) or not all(isinstance(entry, kind) for entry in entries):
            raise InputError(f"{key} must be a list of {'names' if kind is str else 'tables'}")


def section_of(key: str) -> str:
    """The first part of a key, with which the reader's sentences begin."""
    return key.partition(".")[0]


def default_of(key: str) -> Any:
    """What holds where a file lacks the key; None: nothing does."""
    value: Any = DEFAULTS
    for part in key.split("."):
        value = getattr(value, part, None)
    return value


def to_text(key: str, value: Any) -> Any:
    """What the field of a key shows for its value."""
    if key == "form":
        return form_text(value)
    if key == "instruction":
        return PAGE_BREAK.join(str(page.get("text", "")) for page in value)
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else value


def from_text(key: str, value: Any, before: Any) -> Any:
    """The value of a key from that of its field; before: its value so far."""
    if key == "participants":
        return [label.strip() for label in str(value).split(",") if label.strip()] if value else None
    if key == "form":
        return form_of(value or "")
    if key == "instruction":  # a page keeps its picture
        texts = filter(None, map(str.strip, (value or "").split(PAGE_BREAK)))
        pages = itertools.zip_longest(before, texts)
        return [{**(page or {}), "text": text} for page, text in pages if text] or None
    return "" if value is None and key == "name" else value


def form_of(text: str) -> dict[str, Any] | None:
    """The table of a form from "handedness: right, left; age: number"; None: there is none."""
    form: dict[str, Any] = {}
    for part in filter(None, (part.strip() for part in text.split(";"))):
        name, _, kind = part.partition(":")
        kinds = [choice.strip() for choice in kind.split(",")]
        form[name.strip()] = kinds if len(kinds) > 1 else kinds[0]
    return form or None


def form_text(form: dict[str, Any]) -> str:
    """The same as text."""
    words = {name: ", ".join(map(str, kind)) if isinstance(kind, list) else kind for name, kind in form.items()}
    return "; ".join(f"{name}: {kind}" for name, kind in words.items())
