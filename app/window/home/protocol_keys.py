"""The keys of a protocol that its editor shows in fields: their lines, their labels, and how a value is typed."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from app.window.widgets.fields import Field, LongText, NumberField, TextField, make_field
from core.control.rule_sets import RULE_SETS
from experiments.language import shipped_languages
from experiments.protocol_file import FEEDBACK, Settings

#: heading of the form -> its lines, of one key of the file or two, with what stands at each field
LINES: Mapping[str, Sequence[Mapping[str, str]]] = {
    "": [{"name": "Name"}],
    "Trials": [
        {"blocks": "Blocks", "repetitions": "Repetitions"},
        {"practice_trials": "Practice trials", "seed": "Seed"},
        {"breaks.after_trials": "Break after trials", "breaks.least_s": "Shortest break (s)"},
        {"trial.time_out_s": "Longest move (s)", "trial.approach_time_out_s": "Longest approach (s)"},
        {"rules": "Rules", "blind": "Blind: codes for controllers"},
    ],
    "People": [
        {"participants": "Participants"},
        {"language": "Language", "feedback": "Feedback"},
        {"show_linkage": "The linkage is shown", "tones": "Tones at “go” and at the end"},
        {"questionnaire.on": "A questionnaire after each block"},
        {"consent.text": "Consent"},
        {"form": "Form"},
        {"instruction": "Instructions"},
    ],
}
LABELS = {key: label for lines in LINES.values() for line in lines for key, label in line.items()}
CHOICES: dict[str, tuple[str, ...]] = {
    "rules": tuple(RULE_SETS), "feedback": FEEDBACK, "language": tuple(shipped_languages())
}  # fmt: skip
HINTS = {
    "participants": "01, 02, 03; none named: anybody",
    "trial.approach_time_out_s": "of a simulated operator; a person has 10 minutes",
    "consent.text": "What the participant agrees to before the form; empty: consent is not asked.",
    "form": "handedness: right, left; age: number",
    "instruction": "What the participant reads first; a line of --- begins another page.",
}
TEXTS, LONG_TEXTS = ("name", "participants", "form"), ("consent.text", "instruction")  # keys that are typed as text
DEFAULTS = Settings(name="")
PAGE_BREAK = "\n---\n"  # between the pages of instructions
LONGEST = 10_000  # letters of a field: a form, or the labels of many participants
LONG_PX = 90  # high, a text of several lines


def field_of(key: str) -> Field:
    """The field of a key."""
    if key in LONG_TEXTS:
        long = LongText(LABELS[key])
        long.setFixedHeight(LONG_PX)
        long.setPlaceholderText(HINTS[key])
        return long
    choices = {choice: choice for choice in CHOICES.get(key, ())}
    field = make_field(LABELS[key], str if key in TEXTS else type(default_of(key)), choices)
    if isinstance(field, TextField):
        field.setMaxLength(LONGEST)
        field.setPlaceholderText(HINTS.get(key, ""))
    if isinstance(field, NumberField):
        field.setToolTip(HINTS.get(key, ""))
    return field


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
    return "; ".join(f"{name}: {kind if isinstance(kind, str) else ', '.join(kind)}" for name, kind in form.items())
