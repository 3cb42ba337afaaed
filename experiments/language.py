"""The language of the participant: every sentence on their screen, from a file that a translation replaces."""

import string
import tomllib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from core.files import InputError, plain_toml, read_text, shipped_names, shipped_or_file

FOLDER = Path(__file__).resolve().parent / "languages"
ENGLISH = "en"
Language = Mapping[str, str]  # key -> sentence


def shipped_languages() -> list[str]:
    """Names of the languages that come with the product."""
    return shipped_names(FOLDER)


def language_text(name_or_path: str, folder: Path) -> str:
    """The text of a shipped language by its name, or of a file by its path from `folder`. InputError: there is none."""
    return read_text(shipped_or_file(name_or_path, FOLDER, folder, "unknown language"))


@lru_cache
def read_language(text: str, where: str) -> Language:
    """A language from its file's text. InputError, in one sentence, unless it has English's keys and placeholders."""
    found = plain_toml(text, where)
    for key in {**ENGLISH_WORDS, **found}:
        if key not in found or key not in ENGLISH_WORDS:
            raise InputError(f"{where}: {key} {'is missing' if key not in found else 'is not a known key'}")
        if not isinstance(found[key], str) or _filled_in(found[key]) != _filled_in(ENGLISH_WORDS[key]):
            raise InputError(f"{where}: {key} must be a text with what {ENGLISH_WORDS[key]!r} has in braces")
    return found


def _filled_in(sentence: str) -> set[str | None]:
    try:
        return {name for _, name, _, _ in string.Formatter().parse(sentence) if name is not None}
    except ValueError:
        return {None}


ENGLISH_WORDS: Language = tomllib.loads((FOLDER / f"{ENGLISH}.toml").read_text(encoding="utf-8"))
