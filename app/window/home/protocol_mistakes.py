"""A mistake in a protocol's text, as its reader says it: in words of the field, and the line that it is in."""

import re

#: What the reader of TOML says -> the same in words of the field.
TOML_WORDS = {
    "Invalid value": "what stands behind = is missing, or is no value (a text needs quotation marks; yes is true)",
    "Illegal character '\\n'": "a quotation mark is missing at the end of the text",
    "Unterminated string": "a quotation mark is missing at the end of the text",
    "Unclosed array": "a bracket ] is missing at the end of the list",
    "Expected '=' after a key": "= is missing between the key and its value",
    "Expected newline or end of document": "there is more behind the value than it can have",
    "Expected ']'": "a bracket ] is missing behind the name of the table",
}


def in_words(problem: str) -> str:
    """The reader's sentence without its place, which is shown, and without words of the file's syntax."""
    said = problem.removeprefix("is not valid TOML: ")
    said = re.sub(r" \(at (line \d+, column \d+|end of document)\)", "", said)
    if "did you mean" in said:
        said = said.partition(" (there are:")[0]
    if twice := re.match(r"Cannot declare \('(\w+)'.*twice", said):
        return f"the table {twice[1]} is in the text twice"
    return next((words for begins, words in TOML_WORDS.items() if said.startswith(begins)), said)


def set_twice(problem: str, text: str) -> tuple[str, int, int] | None:
    """The key that the reader found a second time, and both of its lines (0 ..); None: it found something else."""
    named = re.search(r"Cannot overwrite a value \(at line (\d+)", problem)
    lines = text.split("\n")
    if not named or not (key := re.match(r"\s*(\w+)", lines[int(named[1]) - 1])):
        return None
    second = int(named[1]) - 1
    table = next((at for at in range(second, -1, -1) if re.match(r"\s*\[", lines[at])), -1)
    first = next((at for at in range(table + 1, second) if re.match(rf"\s*{key[1]}\b", lines[at])), second)
    return key[1], first, second


def line_of(problem: str, text: str) -> int:
    """The line (0 ..) that the reader's sentence is about: the one that it names, else that of the key in its table."""
    lines = text.split("\n")
    if named := re.search(r"at (?:line (\d+)|end of document)", problem):
        return int(named[1] or len(lines)) - 1
    listed, single = re.search(r"\b(\w+) (\d+)\b", problem), re.search(r"\b(\w+)\.\w+", problem)
    heads = [at for at, line in enumerate(lines) if re.match(r"\s*\[", line)]
    begin, end = -1, heads[0] if heads else len(lines)
    found = []
    if listed:
        found = [at for at in heads if re.match(rf"\s*\[\[{listed[1]}\]\]", lines[at])][int(listed[2]) - 1 :]
    elif single:
        found = [at for at in heads if re.match(rf"\s*\[{single[1]}\]", lines[at])]
    if found:
        begin, end = found[0], next((at for at in heads if at > found[0]), len(lines))
    keys = [*range(begin + 1, end), *(() if found else heads)]  # lines that may be named
    inside = {key[1]: at for at in reversed(keys) if (key := re.match(r"\s*(?:\[+(?=\w+\]))?(\w+)\s*[=\]]", lines[at]))}
    mentioned = [inside[word] for word in re.findall(r"\w+", problem) if word in inside]
    values = (
        at for at, line in enumerate(lines) if any(value in problem for value in re.findall(r'"([^"]{3,})"', line))
    )
    return next(iter(mentioned), begin if found else next(values, 0))
