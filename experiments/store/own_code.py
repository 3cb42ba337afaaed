"""Controllers and measures of one's own that the databases of a folder hold, and that may not run yet."""

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path

from core.files import InputError
from core.own_consent import allow, digest_of, is_allowed
from experiments.protocol import is_shipped_code
from experiments.store.database import DATABASE, reading
from experiments.store.files import STUDY

PREFIX = "code/"  # of their names in the table `file`


def unallowed_code(folder: Path) -> dict[str, str]:
    """Name -> text of the code in a folder (a session's, a study's, a data folder) that the user has not allowed.

    The name says the SHA-256, too. None of a database that cannot be read: nothing of it is run.
    """
    found = {}
    for path in _databases(folder):
        with contextlib.suppress(InputError, OSError), reading(path.parent, path.name) as stored:
            for name, _, text in stored.whole_rows("file", "name LIKE ?", f"{PREFIX}%"):
                file = name.removeprefix(PREFIX)
                if not is_allowed(text) and not is_shipped_code(file, text):
                    found[f"{file} (SHA-256 {digest_of(text)[:12]})"] = text
    return {name: text for name, text in found.items() if name.isprintable()}


def _databases(folder: Path) -> Iterator[Path]:
    for depth in ("", "ses-*/", "sub-*/ses-*/"):
        yield from sorted(folder.glob(f"{depth}{DATABASE}"))
    yield from folder.glob(STUDY)


def allow_code(texts: Iterable[str]) -> None:
    """The user has said that these may run."""
    for text in texts:
        allow(text)
