"""Strict TOML files: unknown keys, wrong types and numbers that are not finite are refused in one clear sentence.

A file format is a tree of `Table`s. Every refusal is an `InputError` that names file, key and reason.
"""

import contextlib
import copy
import difflib
import io
import json
import math
import os.path
import re
import tomllib
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

import msgspec

from core.ranges import strange

#: Characters of a word or quotation that a refusal repeats of its input, and of a whole refusal. Our choice.
MOST_REPEATED, MOST_SAID = 200, 1000
#: A text file that is larger is refused: it is hardly one, or has no end (/dev/zero). Our choice: a force at 1 kHz has
#: some 20 bytes a row, so this holds more than an hour of it.
MOST_TEXT_BYTES = 100_000_000
_LONG = re.compile(r"""(?<!\w)'[^']{N,}'|"[^"]{N,}"|\S{N,}""".replace("N", str(MOST_REPEATED + 1)))


def cut(sentence: str) -> str:
    """A sentence in which long words, long quotations and the whole are cut in the middle."""

    def shortened(text: str, most: int) -> str:
        return text if len(text) <= most else f"{text[: most // 2]} [..] {text[-most // 4 :]}"

    return shortened(_LONG.sub(lambda found: shortened(found[0], MOST_REPEATED), sentence), MOST_SAID)


class InputError(Exception):
    """Wrong input of any kind. `str(error)` is one clear sentence for the person who gave it."""

    def __init__(self, sentence: str) -> None:
        super().__init__(cut(sentence))


@contextlib.contextmanager
def naming_errors(sentence: str) -> Iterator[None]:
    """Whatever a library raises over an input becomes an InputError: the sentence, and the library's reason."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise InputError(f"{sentence} ({reason})") from error


def is_assumed(provenance: str) -> bool:
    """Whether some numbers of a file are assumed, by its key `provenance`: the same rule for every file.

    They are where it is empty, or speaks of anything assumed or unknown, if only of one number: "measured; tip mass
    assumed".
    """
    words = provenance.lower()
    return not words.strip() or "assum" in words or "unknown" in words


class StrangeInput(UserWarning):
    """A warning of a number that is allowed, but hardly right. `phd` shows each once, as a line on stderr."""


warnings.simplefilter("ignore", StrangeInput)  # in processes without a stderr that anybody reads: `phd` turns it on


#: In SI units nothing here is larger than a million: such a number is a slip of the pen, and would overflow later.
Positive = Annotated[float, msgspec.Meta(gt=0, le=1e6)]
NotNegative = Annotated[float, msgspec.Meta(ge=0, le=1e6)]
Pair = tuple[float, float]


class Table(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """One table of a file: its fields are the keys it may hold; a field without a default is required."""


T = TypeVar("T", bound=Table)

_TYPE_WORDS = {
    "float": "a number", "int": "a whole number", "str": "text", "array": "a list", "object": "a table",
    "bool": "true or false", "null": "nothing",
}  # fmt: skip
_BOUND_WORDS = {">": "greater than", ">=": "at least", "<": "less than", "<=": "at most"}
_FORMS: dict[str, str] = {}  # msgspec's message -> what the text must be (`text_of_form`)


def read_text(path: Path) -> str:
    """The text of a UTF-8 file with its line ends as "\\n"; an InputError where it cannot be read."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_TEXT_BYTES + 1)
        if len(content) > MOST_TEXT_BYTES:
            raise InputError(f"{path}: is larger than {MOST_TEXT_BYTES / 1e6:g} MB, the most that a text file may have")
        return io.StringIO(content.decode("utf-8-sig"), newline=None).read()
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a text file in UTF-8") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "the path is not valid"
        raise InputError(f"{path}: cannot be read ({(reason or 'unknown reason').lower()})") from None


def refuse_no_file(path: Path) -> None:
    """InputError if something else than a file stands there: a device never ends, a pipe may never begin."""
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no regular file")


def shipped_names(folder: Path) -> list[str]:
    """Names of the files that come with the product in a folder."""
    return sorted(file.stem for file in folder.glob("*.toml"))


def shipped_or_file(reference: str | Path, shipped: Path, folder: Path, unknown: str) -> Path:
    """The shipped file of that name, or the file at that path from `folder`.

    InputError, which `unknown` begins ("unknown device"), if there is neither.
    """
    names = shipped_names(shipped)
    path = shipped / f"{reference}.toml" if str(reference) in names else folder / reference
    if not str(reference) or not os.path.isfile(path):
        raise InputError(f"{unknown} {str(reference)!r}: neither a shipped one ({', '.join(names)}) nor a file")
    return path


def plain_toml(text: str, where: str) -> dict[str, Any]:
    """What stands in TOML text, as plain dicts, lists and numbers; `where` names the file in refusals."""
    try:
        return tomllib.loads(text)
    except (RecursionError, ValueError) as error:
        raise InputError(f"{where}: is not valid TOML: {str(error) or 'nested too deeply'}") from None


def parse_toml(text: str, kind: type[T], where: str) -> T:
    """`text` as a table of the given kind; `where` names the file in refusals."""
    return from_plain(plain_toml(text, where), kind, where)


def from_plain(content: Any, kind: Any, where: str) -> Any:
    """Plain dicts, lists and numbers as the given kind; `where` begins every refusal."""
    _refuse_not_finite(content, "", where)
    try:
        found = msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        message = _with_key(str(error), content, kind)
        raise InputError(f"{where}: {_sentence(message, content, kind).lstrip()}") from None
    for key, doubt in strange(found, kind):
        at, name = _place(key)
        warnings.warn(StrangeInput(f"{where}: {at}{name} = {doubt}"), stacklevel=1)
    return found


def toml_text(content: Mapping[str, Any]) -> str:
    """The TOML text of what `tomllib` reads: dictionaries, lists, texts and numbers.

    Keys keep their order, but tables come after plain values. A key whose value is None is left out.
    """
    return "\n".join(_toml_table(content, "")).strip("\n") + "\n"


def _toml_table(content: Mapping[str, Any], name: str) -> list[str]:
    """The lines of a table: its plain values, then the tables and the lists of tables in it."""
    given = {key: value for key, value in content.items() if value is not None}
    nested = {key: value for key, value in given.items() if isinstance(value, Mapping) or _is_list_of_tables(value)}
    lines = [f"{_toml_key(key)} = {_toml_value(value)}" for key, value in given.items() if key not in nested]
    for key, value in nested.items():
        inner = f"{name}.{_toml_key(key)}" if name else _toml_key(key)
        if isinstance(value, Mapping):
            lines += ["", f"[{inner}]", *_toml_table(value, inner)]
        else:
            for entry in value:
                lines += ["", f"[[{inner}]]", *_toml_table(entry, inner)]
    return lines


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(isinstance(entry, Mapping) for entry in value)


def _toml_key(key: str) -> str:
    return key if key.isascii() and key.replace("_", "").replace("-", "").isalnum() else _toml_value(key)


def _toml_value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml_value, value))}]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # as TOML writes texts, integers, booleans


def text_of_form(pattern: str, words: str) -> msgspec.Meta:
    """For `Annotated[str, ..]`: text that matches the whole pattern; a refusal says that it must be `words`."""
    whole = rf"^(?:{pattern})\Z"
    _FORMS[f"Expected `str` matching regex {whole!r}"] = words
    return msgspec.Meta(pattern=whole)


def choice(*words: str) -> msgspec.Meta:
    """For `Annotated[str, ..]`: text that is one of the words."""
    return text_of_form("|".join(words), f"one of {', '.join(words)}")


def _refuse_not_finite(value: Any, key: str, where: str) -> None:
    if isinstance(value, dict):
        for name, inner in value.items():
            _refuse_not_finite(inner, f"{key}.{name}" if key else name, where)
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            _refuse_not_finite(inner, f"{key}[{i}]", where)
    elif isinstance(value, float) and not math.isfinite(value):
        at, name = _place(key)
        raise InputError(f"{where}: {at}{name}{' ' if key else ''}must be finite, not {value}")


def _with_key(message: str, content: Any, kind: Any) -> str:
    """msgspec's message with the key in place of `[...]`, which is one of a table whose keys are free."""
    place, free, _ = message.partition(" - at `$")[2].partition("[...]")
    table = _value(content, place) if free else {}
    for name, value in [*table.items()]:
        alone = copy.deepcopy(content)
        only = _value(alone, place)
        only.clear()
        only[name] = value
        try:
            msgspec.convert(alone, kind)
        except msgspec.ValidationError as error:
            if str(error) == message:
                return message.replace("[...]", f".{name}", 1)
    return message


def _sentence(message: str, content: dict[str, Any], kind: Any) -> str:
    """msgspec's message in our words; `content` is the file, to show the value at fault.

    Such messages are "Expected `int` >= 1 - at `$.path[0].number`" and "Object missing required field `name`".
    """
    reason, _, place = message.partition(" - at `$")
    key = place.removesuffix("`").removeprefix(".")
    if found := re.fullmatch("Object (missing required|contains unknown) field `(.*)`", reason):
        at, name = _place(f"{key}.{found[2]}" if key else found[2])
        if found[1] == "missing required":
            return f"{at}the required key {name} is missing"
        known = _keys(kind, key)
        listed = f" (there are: {', '.join(known)})" if known else ""
        return f"{at}unknown key {name}{did_you_mean(found[2], known)}{listed}"
    at, name = _place(key)
    if words := _FORMS.get(reason.replace(" | null", "")):
        return f"{at}{name} must be {words}, not {_value(content, key)!r}"
    if found := re.fullmatch("Expected `([^`]*)`, got `([^`]*)`", reason):
        wanted = " or ".join(_TYPE_WORDS.get(t, t) for t in found[1].split(" | ") if t != "null")
        return f"{at}{name} must be {wanted}, not {_TYPE_WORDS.get(found[2], found[2])}"
    if found := re.fullmatch(r"Expected `(?:float|int)(?: \| null)?` (>=|>|<=|<) (\S+)", reason):
        return f"{at}{name} must be {_BOUND_WORDS[found[1]]} {float(found[2]):g}, not {_value(content, key)!r}"
    if found := re.fullmatch("Invalid value '(.*)'", reason):
        return f"{at}{name} {found[1]!r} is not known"
    if found := re.fullmatch(r"Expected `array` of length ((?:>=|<=) )?(\d+)(?:, got \d+)?", reason):
        bound = {">=": "at least ", "<=": "at most "}.get((found[1] or "").strip(), "")
        values = "value" if found[2] == "1" else "values"
        return f"{at}{name} must hold {bound}{found[2]} {values}, not {len(_value(content, key))}"
    return f"{_numbered(key)}: {reason}" if key else reason


def _place(key: str) -> tuple[str, str]:
    """The table of a list in which a key stands, and what the key is called there; lists are counted from 1.

    `controller[1].gap_m` is ("controller 2: ", "gap_m"), `start_m[0]` is ("", "value 1 of start_m").
    """
    table, is_listed, name = key.rpartition("].")
    while found := re.fullmatch(r"(.*)\[(\d+)\]", name.rpartition(" of ")[2]):
        part = "point" if re.fullmatch(r"points\w*", found[1]) else "value"
        name = name.removesuffix(found[0]) + f"{part} {int(found[2]) + 1} of {found[1]}"
    return (f"{_numbered(table + ']')}: " if is_listed else ""), name


def _numbered(key: str) -> str:
    """`controller[1]` as "controller 2"."""
    return re.sub(r"\[(\d+)\]", lambda found: f" {int(found[1]) + 1}", key)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A question with the known word that a misspelt one is most like; empty where none is near."""
    near = difflib.get_close_matches(word, list(known), 1, 0.65)
    return f", did you mean {near[0]}?" if near else ""


def _keys(kind: Any, key: str) -> list[str]:
    """The keys of the table that stands at a key in a file of this kind; none where no table stands."""
    table = table_in(kind)
    for name in re.sub(r"\[[^\]]*\]", "", key).split(".") if key else ():
        fields = msgspec.structs.fields(table) if table else ()
        table = next((table_in(field.type) for field in fields if field.name == name), None)
    return [field.name for field in msgspec.structs.fields(table)] if table else []


def table_in(kind: Any) -> type[msgspec.Struct] | None:
    """The table in a type such as `tuple[Table, ...]` or `Table | None`."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return kind
    return next(filter(None, map(table_in, get_args(kind))), None)


def _value(content: Any, key: str) -> Any:
    """The value at a key such as `mass.AE.com_m` or `geometry.base_A_m[0]`."""
    for name, index in re.findall(r"([^.\[\]]+)|\[(\d+)\]", key):
        content = content[name] if name else content[int(index)]
    return content
