"""Writes protocol files: TOML that `experiments.protocol` reads."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from core.files import InputError
from experiments.protocol import read_protocol
from experiments.recording.atomic_files import reason_of, write_new_file, written_beside

ABOUT = "# A protocol of phd. The shipped experiments/protocols/paper.toml says what each key is.\n"


def protocol_text(content: Mapping[str, Any]) -> str:
    """The TOML text of a protocol that is given as `tomllib` reads it: dictionaries, lists, texts and numbers.

    Keys keep their order, but tables come after plain values. A key whose value is None is left out.
    """
    return ABOUT + "\n".join(_table(content, "")).strip("\n") + "\n"


def save_protocol(path: Path, content: Mapping[str, Any], replacing: bool = False) -> None:
    """Write a protocol file that can be run. InputError, and nothing written, if it cannot, or if the file exists.

    replacing: an existing file is replaced. Devices given by path are looked for from the file's folder.
    """
    text = protocol_text(content)
    read_protocol(text, path.parent, str(path))
    try:
        if replacing:
            with written_beside(path, text.encode()) as partial:
                partial.replace(path)
        else:
            write_new_file(path, text.encode(), sync=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({reason_of(error)})") from None


def _table(content: Mapping[str, Any], name: str) -> list[str]:
    """The lines of a table: its plain values, then the tables and the lists of tables in it."""
    given = {key: value for key, value in content.items() if value is not None}
    nested = {key: value for key, value in given.items() if isinstance(value, Mapping) or _is_list_of_tables(value)}
    lines = [f"{_key(key)} = {_value(value)}" for key, value in given.items() if key not in nested]
    for key, value in nested.items():
        inner = f"{name}.{_key(key)}" if name else _key(key)
        if isinstance(value, Mapping):
            lines += ["", f"[{inner}]", *_table(value, inner)]
        else:
            for entry in value:
                lines += ["", f"[[{inner}]]", *_table(entry, inner)]
    return lines


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(isinstance(entry, Mapping) for entry in value)


def _key(key: str) -> str:
    return key if key.isascii() and key.replace("_", "").replace("-", "").isalnum() else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # as TOML writes texts, integers, booleans
