"""Which code of one's own may run: what this user started, and what came out of a session's folder and was allowed.

Code is known by the SHA-256 of its text. A protocol that somebody starts is trusted as a script is, with its files.
Code that a session's folder holds may come from anybody: it runs only after the user was asked. What is allowed is
remembered for the user in a file beside the settings; the environment hands it to the processes that this one starts.
"""

import contextlib
import hashlib
import os
import stat
from pathlib import Path

from core.files import InputError

VARIABLE = "PHD_OWN_CODE"  # SHA-256s of what is allowed, or `EVERYTHING`
EVERYTHING = "everything"
FILE = "phd-own-code"  # a SHA-256 a line
OPTION = "--run-own-code"


class NotAllowed(InputError):
    """Code that came out of a session's folder, and that this user has not allowed to run."""


def digest_of(text: str) -> str:
    """The SHA-256 of a text."""
    return hashlib.sha256(text.encode()).hexdigest()


def allow(text: str) -> None:
    """Let the code of this text run, now and later. Where no file can be written: only until this process ends."""
    if is_allowed(text):
        return
    digest = digest_of(text)
    os.environ[VARIABLE] = f"{os.environ.get(VARIABLE, '')} {digest}".strip()
    with contextlib.suppress(OSError, RuntimeError):
        file = _file()
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0), 0o600)
        with os.fdopen(handle, "w", encoding="ascii") as opened:
            opened.write(f"{digest}\n")


def allow_everything() -> None:
    """In a process that another one of this program started and gives code to: that one has asked."""
    os.environ[VARIABLE] = EVERYTHING


def is_allowed(text: str) -> bool:
    """Whether the code of this text may run."""
    here = _in_environment()
    return EVERYTHING in here or digest_of(text) in here or digest_of(text) in _remembered()


def refuse_unallowed(name: str, text: str) -> None:
    """NotAllowed, one sentence, unless the code of this text may run."""
    if not is_allowed(text):
        raise NotAllowed(
            f"{name} (SHA-256 {digest_of(text)[:12]}) came out of the folder of a session and was not allowed to run; "
            f"{OPTION} allows it"
        )


def _in_environment() -> list[str]:
    return os.environ.get(VARIABLE, "").split()


def _file() -> Path:
    if os.name == "nt":
        return Path(os.environ.get("APPDATA", Path.home())) / FILE
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / FILE


def _remembered() -> list[str]:
    """What the file says; nothing where it is not the user's own, or others may write it."""
    try:
        with _file().open(encoding="ascii") as file:
            about = os.fstat(file.fileno())
            if os.name != "nt" and (about.st_uid != os.geteuid() or about.st_mode & (stat.S_IWGRP | stat.S_IWOTH)):
                return []
            return file.read().split()
    except (OSError, ValueError, RuntimeError):  # RuntimeError: this user has no home folder
        return []
