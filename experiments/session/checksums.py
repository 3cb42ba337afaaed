"""Checksums of what a session stores beside its recordings: of the JSON files as a whole, and of each journal line.

session.json, study.json and journal.end carry `crc32`: the CRC-32 (as in zip; 8 lower-case hex digits) of everything
else in them, as JSON with sorted keys, without spaces, in ASCII. Another indentation changes nothing, another meaning
does. A file without `crc32` is of an earlier version: it is read, and `phd verify` says that nothing guards it.

A line of journal.jsonl ends in `"after"` and `"crc32"`. `crc32` is the checksum of the line itself up to these digits;
`after` that of all lines from the last whole one before it (from the first line, where none is whole) to the line above
it, joined by line feeds: 00000000 for the first line of the file. So each line can be judged alone, and a line that is
missing, doubled or out of place breaks the chain. A line that a crash cut off, or that an earlier version wrote, has no
`crc32` and is in the chain all the same.

journal.end has the number of lines and the last checksum at the time when the session was last left in order: from then
on the journal may be longer, never shorter.

All this finds accidents: a bit that a disk or a copy lost, a line deleted or a number typed over by mistake. It is no
proof against a person who changes a file on purpose, for that person can compute the checksums again.
"""

import contextlib
import json
import re
import zlib
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from core.files import InputError
from experiments.recording.atomic_files import reading_stored, replace_file

CHECKSUM, AFTER = "crc32", "after"
END = "journal.end"
NO_CHECKSUM = "no checksum, written by an earlier version"
CANNOT_BE_READ = "cannot be read"

_HEX = rb"[0-9a-f]{8}"
_WHOLE = re.compile(rb'(?P<before>.*, "after": "(?P<after>%b)", "crc32": ")(?P<own>%b)"\}' % (_HEX, _HEX), re.DOTALL)
_CHECKSUM_IN_IT = re.compile(rb'"crc32": "%b"\}' % _HEX)


def _digits(data: bytes) -> str:
    return f"{zlib.crc32(data):08x}"


# ----------------------------------------------------------------------------------------------- a JSON file as a whole


def sealed(about: Mapping[str, Any]) -> bytes:
    """The text of a JSON file with its checksum in it."""
    plain = json.loads(json.dumps(about))
    return json.dumps(plain | {CHECKSUM: _of_meaning(plain)}, indent=1, sort_keys=True).encode() + b"\n"


def read_sealed(path: Path) -> dict[str, Any]:
    """Read a JSON file; under `CHECKSUM` its checksum, unless an earlier version wrote it.

    InputError: it cannot be read, is no JSON object, or does not match its checksum.
    """
    with reading_stored(path):
        about = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(about, dict):
            raise InputError(f"{path}: is damaged (it holds no JSON object)")
        meant = {key: value for key, value in about.items() if key != CHECKSUM}
        if CHECKSUM in about and about[CHECKSUM] != _of_meaning(meant):
            raise InputError(f"{path}: does not match its checksum, it was changed")
    return about


def _of_meaning(plain: Mapping[str, Any]) -> str:
    return _digits(json.dumps(plain, sort_keys=True, separators=(",", ":")).encode())


# ----------------------------------------------------------------------------------------------- the lines of a journal


class Lines(NamedTuple):
    """The readable lines of a journal, counted from 1, and the faults of the others."""

    valid: dict[int, dict[str, Any]]  # line -> its fields
    faults: list[str]  # which lines are damaged or missing
    notes: list[str]  # no faults: lines without a checksum, or that a crash cut off
    whole: list[str]  # checksums of the whole lines
    length: int  # lines of any kind


def next_line(about: Mapping[str, Any], journal: bytes) -> bytes:
    """The next line of a journal, with its checksums."""
    texts = journal.splitlines()
    start = next((i for i in reversed(range(len(texts))) if _checksums(texts[i])), 0)
    text = json.dumps({**about, AFTER: _digits(b"\n".join(texts[start:]))})
    before = f'{text[:-1]}, "{CHECKSUM}": "'.encode()
    return before + _digits(before).encode() + b'"}\n'


def read_lines(journal: bytes) -> Lines:
    """The valid lines of a journal, and the faults of the others.

    Whole lines stand by themselves. Lines without a checksum are judged by the next whole line, whose `after` is that
    of them and of the whole line before them.
    """
    texts = journal.splitlines()
    whole = {i: found for i, text in enumerate(texts) if (found := _checksums(text))}
    read = Lines({}, [], [], [found.own for found in whole.values()], len(texts))
    unguarded: list[int] = []
    last_is_open = bool(texts) and not journal.endswith((b"\n", b"\r"))
    for before, i in pairwise((None, *whole, None)):  # two whole lines; None: the start or the end of the journal
        first, end = 0 if before is None else before + 1, len(texts) if i is None else i
        follows = i is not None and whole[i].after == _digits(b"\n".join(texts[before or 0 : i]))
        is_changed = before is not None and i is not None and not follows
        faults = len(read.faults)
        for j in range(first, end):
            may_be_cut = follows or not whole or (last_is_open and j == len(texts) - 1)
            about, fault = _without_checksum(texts[j], is_changed, may_be_cut)
            if about is not None:
                read.valid[j + 1] = about
                unguarded.append(j)
            elif fault:
                read.faults.append(f"line {j + 1}: {fault}")
            else:
                read.notes.append(f"line {j + 1}: was not finished, a crash cut it off")
        if i is None:
            break
        if not follows and len(read.faults) == faults:
            read.faults.append(_break_of_chain(texts, i, before))
        if follows or texts[i] not in texts[:i]:
            if (about := _json_object(texts[i])) is None:
                read.faults.append(f"line {i + 1}: {CANNOT_BE_READ}")
            else:
                read.valid[i + 1] = {key: value for key, value in about.items() if key not in (AFTER, CHECKSUM)}
    if unguarded:
        read.notes.append(f"{_lines(unguarded)}: {NO_CHECKSUM}")
    return read


def _without_checksum(text: bytes, is_changed: bool, may_be_cut: bool) -> tuple[dict[str, Any] | None, str]:
    """The fields of a line that an earlier version wrote, or None and its fault, "" for one that a crash cut off.

    is_changed: since the next whole line was written.
    """
    had_checksum = _CHECKSUM_IN_IT.search(text) is not None
    about = None if is_changed or had_checksum else _json_object(text)
    if about is not None and not {AFTER, CHECKSUM} & about.keys():
        return about, ""
    if about is None and may_be_cut and not had_checksum and not text.endswith(b"}"):
        return None, ""
    if is_changed or had_checksum or about is not None:
        return None, "does not match its checksum, it was changed"
    return None, CANNOT_BE_READ


class _Checksums(NamedTuple):
    """Those at the end of a whole line."""

    after: str  # of the lines before it
    own: str


def _checksums(text: bytes) -> _Checksums | None:
    """The checksums of a line that matches its own; None: it does not, or has none."""
    found = _WHOLE.fullmatch(text)
    if found is None or found["own"].decode() != _digits(found["before"]):
        return None
    return _Checksums(found["after"].decode(), found["own"].decode())


def _break_of_chain(texts: Sequence[bytes], i: int, before: int | None) -> str:
    """The fault where a line does not follow the one before it."""
    if texts[i] in texts[:i]:
        return f"line {i + 1}: is the same as line {texts.index(texts[i]) + 1}"
    if before is None and i:
        return f"{_lines(range(i))}: changed since, or lines are missing, by the checksum in line {i + 1}"
    return f"line {i + 1}: the lines before it are missing, or it is out of place"


def _json_object(text: bytes) -> dict[str, Any] | None:
    with contextlib.suppress(ValueError, RecursionError):
        about = json.loads(text)
        return about if isinstance(about, dict) else None
    return None


def _lines(places: Sequence[int]) -> str:
    """ "line 3", "lines 1 to 20", "20 lines from line 1 on"."""
    first, last = places[0] + 1, places[-1] + 1
    if first == last:
        return f"line {first}"
    return f"lines {first} to {last}" if last - first < len(places) else f"{len(places)} lines from line {first} on"


# --------------------------------------------------------------------------------------------------- a journal's end


class NotedEnd(NamedTuple):
    """The length of a journal when its session was last closed."""

    lines: int
    last: str  # checksum of the last whole line


def noted_end(session: Path) -> NotedEnd | None:
    """The noted end of a journal, to be read before the journal; None: there is none. InputError: it is damaged."""
    path = session / END
    if not path.exists():
        return None
    about = read_sealed(path)
    if CHECKSUM not in about:  # it never was without
        raise InputError(f"{path}: is damaged (its checksum is missing)")
    with reading_stored(path):
        return NotedEnd(int(about["lines"]), str(about["last"]))


def fault_of_end(end: NotedEnd | None, read: Lines) -> str:
    """The part that a journal lacks before its noted end; "": none."""
    if end is None or end.last in read.whole:
        return ""
    if read.length < end.lines:
        return f"its last lines are missing, {read.length} of {end.lines} are there"
    return "" if read.faults else f"lacks the line that was its last one, line {end.lines}"  # named, if it is damaged


def note_end(session: Path, read: Lines, sync: bool) -> None:
    """Note how long the journal of a session is. The caller holds the lock.

    A journal shorter than an earlier note keeps that note, and so its fault. If the note cannot be written, the earlier
    one stays, which is true too.
    """
    with contextlib.suppress(InputError, OSError):
        end = noted_end(session)
        new = NotedEnd(read.length, read.whole[-1]) if read.whole else end
        if new is not None and new != end and not fault_of_end(end, read):
            replace_file(session / END, sealed(new._asdict()), sync)
