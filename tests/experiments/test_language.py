"""The participant's language: shipped ones, a translation file, and what is refused."""

from pathlib import Path

import pytest

from core.files import InputError
from experiments.language import ENGLISH_WORDS, FOLDER, read_language, shipped_languages
from experiments.protocol import SHIPPED_FOLDER, load_protocol, protocol_from_json, protocol_to_json

GERMAN = (FOLDER / "de.toml").read_text(encoding="utf-8")
PAPER = (SHIPPED_FOLDER / "paper.toml").read_text(encoding="utf-8")


def with_lines(folder: Path, *lines: str, text: str = PAPER) -> Path:
    """A protocol file that begins with these lines."""
    path = folder / "mine.toml"
    path.write_text("\n".join(lines) + "\n" + text, encoding="utf-8")
    return path


def test_english_and_german_are_shipped_with_the_same_sentences() -> None:
    assert {"en", "de"} <= set(shipped_languages())
    assert set(read_language(GERMAN, "de")) == set(ENGLISH_WORDS)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (GERMAN.replace("hold = ", "hald = "), "hold is missing"),
        (GERMAN + 'more = "x"\n', "more is no sentence of the screens"),
        (GERMAN.replace("{seconds} Sekunden", "Sekunden"), "time must be a text"),
        (GERMAN.replace("{seconds} Sekunden", "{seconds Sekunden"), "time must be a text"),
        ("hold = 3", "approach is missing"),
    ],
)
def test_a_translation_that_lacks_a_sentence_or_a_placeholder_is_refused(text: str, what: str) -> None:
    with pytest.raises(InputError, match=what):
        read_language(text, "mine.toml")


def test_a_protocol_takes_a_shipped_language_or_a_file_and_keeps_it_when_the_file_is_gone(tmp_path: Path) -> None:
    assert load_protocol().sentences["go"] == "Go"
    assert load_protocol(with_lines(tmp_path, 'language = "de"')).sentences["go"] == "Los"
    own = tmp_path / "nl.toml"
    own.write_text(GERMAN.replace('go = "Los"', 'go = "Start"'), encoding="utf-8")
    stored = protocol_to_json(load_protocol(with_lines(tmp_path, 'language = "nl.toml"')))
    own.unlink()
    assert protocol_from_json(stored, "session.json").sentences["go"] == "Start"
    with pytest.raises(InputError, match="mine.toml: language: unknown language 'nl.toml'"):
        load_protocol(tmp_path / "mine.toml")


def test_instructions_keep_their_pictures_with_the_session(tmp_path: Path) -> None:
    (tmp_path / "grip.png").write_bytes(b"picture")
    pages = '\n[[instruction]]\ntext = "Hold the handle."\npicture = "grip.png"\n[[instruction]]\ntext = "Go on."\n'
    path = with_lines(tmp_path, text=PAPER + pages)
    stored = protocol_to_json(load_protocol(path))
    (tmp_path / "grip.png").unlink()
    assert protocol_from_json(stored, "session.json").pages == (("Hold the handle.", b"picture"), ("Go on.", b""))
    with pytest.raises(InputError, match="instruction: .*grip.png: no such file"):
        load_protocol(path)
