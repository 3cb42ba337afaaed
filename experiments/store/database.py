"""A session's database, session.db: one SQLite file, written by one process and read by any (the page of its format:
docs/files-and-commands.md).

What is committed is there after a kill or a power cut; what is not was never half there. What the disk refuses stays in
memory, in order, and goes with the next commit that it takes.

SQLite finds damage of its own pages alone, so each row ends with a checksum: the CRC-32 of the session's identity, the
table's name and the row's values. A row that was changed, exchanged or brought from another session does not match it.
Numbered rows have no gaps; how many there are stands in `counts`, which is sealed when the session is closed.
"""

import contextlib
import errno
import json
import os
import shutil
import sqlite3
import tempfile
import threading
import time
import uuid
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

from core.files import InputError
from experiments.atomic_files import new_beside, reason_of, retry_while_locked, sync_folder

DATABASE = "session.db"
FORMAT = 2  # `user_version`; rises when its form changes: one format is read
APPLICATION = 0x50484400  # `application_id`: PHD
BUSY_S = 5.0  # that another process may read while we write
#: Table -> its columns, the first of which is its key; each has one more, the row's checksum.
TABLES = {
    "about": ("name TEXT", "value TEXT"),
    "file": ("name TEXT", "sha256 TEXT", "text TEXT"),
    "plan": ("run INTEGER", "block INT", "configuration TEXT", "controller ANY", "path INT", "repetition INT"),
    "blind_key": ("code TEXT", "controller INT"),
    "event": ("number INTEGER", "time TEXT", "monotonic_s REAL", "name TEXT", "about TEXT"),
    "trial": (
        "number INTEGER", "folder TEXT", "run INT", "about TEXT", "outcome TEXT", "ticks INT", "bytes INT",
        "sha256 TEXT",
    ),
    "ticks": ("number INTEGER", "trial INT", "first INT", "count INT", "columns BLOB"),
    "result": ("number INTEGER", "run INT", "cells TEXT"),
    "counts": ("name TEXT", "rows INT", "sum INT"),
}  # fmt: skip
#: Tables whose rows are numbered from 1 on; those of `ticks` leave it.
NUMBERED = ("event", "trial", "result")
SEALED = "sealed"  # row of `counts`: `rows` is 1 while the session is closed, and each sum that of its table
_SCHEMA = f"PRAGMA user_version={FORMAT}; PRAGMA application_id={APPLICATION}; " + "; ".join(
    f"CREATE TABLE {table} ({', '.join((f'{columns[0]} PRIMARY KEY', *columns[1:]))}, crc INT) STRICT"
    for table, columns in TABLES.items()
)
_PUT = {
    table: f"INSERT OR REPLACE INTO {table} VALUES ({', '.join('?' * (len(of) + 1))})" for table, of in TABLES.items()
}
_DROP_TICKS = "DELETE FROM ticks WHERE trial = ?"
#: What SQLite says where processes share no memory, as on a network drive.
_NO_SHARED_MEMORY = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_PROTOCOL)
_ERRNO = {
    sqlite3.SQLITE_FULL: errno.ENOSPC,
    sqlite3.SQLITE_READONLY: errno.EROFS,
    sqlite3.SQLITE_CANTOPEN: errno.ENOENT,
    sqlite3.SQLITE_PERM: errno.EACCES,
}


def checksum(identity: str, table: str, values: Sequence[Any]) -> int:
    """The checksum of a row. Its columns have types, so that their texts tell the values."""
    texts = (identity, table, *values)
    return zlib.crc32(b"\0".join(part if isinstance(part, bytes) else str(part).encode() for part in texts))


class Row(NamedTuple):
    """A row of a table as it was read."""

    values: tuple
    whole: bool  # it matches its checksum


class StoredTrial(NamedTuple):
    """A trial as the database has it."""

    number: int
    folder: str
    run: int
    about: str  # its `description`
    outcome: str  # JSON; "": it has not ended
    ticks: int  # once it has ended
    bytes: int  # of its file
    sha256: str  # of its file; "": its ticks are in the database

    @property
    def name(self) -> str:
        """Of its file, in the folder of the session."""
        return f"{self.folder}/run-{self.run:03d}.parquet"


class Database:
    """A session's database, open for writing by the one process that holds the session's lock."""

    def __init__(self, folder: Path, sync: bool = True, name: str = DATABASE) -> None:
        """sync: a commit waits for the disk itself, so that a power cut costs nothing that was committed.

        InputError: it cannot be read, or is of a later format. OSError: the disk.
        """
        self.path, self._sync = folder / name, sync
        self.trouble: OSError | None = None  # why the last commit failed
        self.longest_sync_s = 0.0  # that the disk made us wait
        self._pending: list[tuple[str, tuple]] = []
        self.pending_ticks = self.pending_bytes = 0  # of the ticks that are in memory alone
        self._memory, self._disk = threading.Lock(), threading.Lock()
        self._db: sqlite3.Connection | None = None  # once something is written
        with reading(folder, name) as stored:
            self.identity, self._is_sealed = stored.identity, stored.is_sealed
            self._given = stored.given()  # the numbers given last
            self._ticks = stored.last("ticks")
        self._file = os.stat(self.path)

    def _connected(self) -> sqlite3.Connection:
        if self._db is None:
            try:
                self._db = self._connect("WAL", "NORMAL")
            except sqlite3.OperationalError as error:
                if error.sqlite_errorcode & 0xFF not in _NO_SHARED_MEMORY:
                    raise
                self._db = self._connect("DELETE", "EXCLUSIVE")  # so a WAL that is there is left without it
        return self._db

    def _connect(self, journal: str, locking: str) -> sqlite3.Connection:
        """journal: the write-ahead log, or a rollback journal; locking: while that is chosen."""
        db = sqlite3.connect(self.path, timeout=BUSY_S, isolation_level=None, check_same_thread=False)
        try:
            db.execute(f"PRAGMA locking_mode={locking}").fetchall()
            db.execute(f"PRAGMA synchronous={'EXTRA' if self._sync else 'NORMAL'}")  # the end of a journal's file, too
            db.execute(f"PRAGMA journal_mode={journal}").fetchall()
            db.execute("PRAGMA locking_mode=NORMAL").fetchall()
            db.execute("BEGIN IMMEDIATE")
            db.execute("ROLLBACK")
        except BaseException:
            db.close()
            raise
        return db

    # ------------------------------------------------------------------------------------------------------ into memory

    def put(self, table: str, *values: Any) -> None:
        """A row for the next commit, new or in place of the one with its key."""
        with self._memory:
            self._put(table, values)

    def add(self, table: str, *values: Any) -> int:
        """A row for the next commit; the number that it gets."""
        with self._memory:
            if table == "ticks":
                self._ticks += 1
                self.pending_ticks += values[2]
                self.pending_bytes += len(values[3])
                number = self._ticks
            else:
                self._given[table] += 1
                number = self._given[table]
                self._put("counts", (table, number, 0))
            self._put(table, (number, *values))
        return number

    def _put(self, table: str, values: tuple) -> None:
        self._pending.append((_PUT[table], (*values, checksum(self.identity, table, values))))

    def drop_ticks(self, trial: int) -> None:
        """Remove a trial's ticks with the next commit: they are in its file."""
        with self._memory:
            self._pending.append((_DROP_TICKS, (trial,)))

    @property
    def pending(self) -> int:
        """Changes that are in memory alone."""
        return len(self._pending)

    def pending_in(self, table: str) -> int:
        """Rows of a table that are in memory alone."""
        return sum(statement is _PUT[table] for statement, _ in self._pending[:])

    @contextlib.contextmanager
    def at_once(self) -> Iterator[None]:
        """What is added and committed here is forgotten if the disk refuses it: OSError."""
        with self._memory:
            number, given = len(self._pending), dict(self._given)
        try:
            yield
        except OSError:
            with self._memory:
                del self._pending[number:]
                self._given = given
            raise

    # ------------------------------------------------------------------------------------------------------ to the disk

    def commit(self) -> None:
        """Write everything that is in memory, whole or not at all. OSError: it stays there, for the next commit."""
        with self._disk:
            began = time.perf_counter()
            with self._memory:
                number, ticks, size = len(self._pending), self.pending_ticks, self.pending_bytes
            if not number:
                return
            try:
                with _as_os_error(self.path):
                    self._refuse_other_file()
                    self._write(self._connected(), self._pending[:number])
            except InputError as error:  # the file was damaged meanwhile
                self.trouble = OSError(errno.EIO, str(error), str(self.path))
                raise self.trouble from None
            except OSError as error:
                self.trouble = error
                raise
            with self._memory:
                del self._pending[:number]
                self.pending_ticks -= ticks
                self.pending_bytes -= size
            self.trouble = None
            self.longest_sync_s = max(self.longest_sync_s, time.perf_counter() - began)

    def _write(self, db: sqlite3.Connection, changes: Sequence[tuple[str, tuple]]) -> None:
        db.execute("BEGIN IMMEDIATE")
        try:
            if self._is_sealed:
                db.execute(*self._counts(SEALED, 0, 0))
            for statement, values in changes:
                db.execute(statement, values)
            db.execute("COMMIT")
        except BaseException:
            with contextlib.suppress(sqlite3.Error):
                db.execute("ROLLBACK")
            raise
        self._is_sealed = False

    def _counts(self, *values: Any) -> tuple[str, tuple]:
        return _PUT["counts"], (*values, checksum(self.identity, "counts", values))

    def _refuse_other_file(self) -> None:
        """FileNotFoundError if the database is gone from its place: its folder was deleted, or its disk removed."""
        if os.name == "posix" and not os.path.samestat(os.stat(self.path), self._file):  # Windows keeps a file in use
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(self.path))

    def reopen(self) -> None:
        """Open it again, in a folder that was gone and is back. InputError: it is another session's. OSError."""
        with self._disk:
            with reading(self.path.parent, self.path.name) as stored:
                if stored.identity != self.identity:
                    raise InputError(f"{self.path}: is another session's")
            if self._db is not None:
                with contextlib.suppress(sqlite3.Error):
                    self._db.close()
            self._db, self._file = None, os.stat(self.path)

    def close(self) -> None:
        """Write what is in memory, seal the counts, and leave one plain file. OSError: it could not be written."""
        try:
            self.commit()
            if not self._is_sealed:
                self._seal()
        finally:
            self.disconnect()

    def disconnect(self) -> None:
        """Let go of the file; what is in memory stays there."""
        if self._db is not None:
            with contextlib.suppress(sqlite3.Error):  # a reader has it open, or the disk is full: it is whole as it is
                if self._db.execute("PRAGMA freelist_count").fetchone()[0]:
                    self._db.execute("VACUUM")
            with contextlib.suppress(sqlite3.Error):
                self._db.execute("PRAGMA journal_mode=DELETE").fetchall()
            with contextlib.suppress(sqlite3.Error):
                self._db.close()
        self._db = None

    def _seal(self) -> None:
        with _as_os_error(self.path):
            self._refuse_other_file()
            db = self._connected()
            there = counted(db)
            counts = {table: (self._given.get(table, rows), sum_of) for table, (rows, sum_of) in there.items()}
            counts[SEALED] = 1, 0
            self._write(db, [self._counts(name, *count) for name, count in counts.items()])
            self._is_sealed = True

    def rescue(self, place: Path) -> None:
        """Write what is in memory into a database at another place, whole or not at all. OSError."""
        with new_database(place, identity=self.identity) as rescued:
            rescued._pending += [change for change in self._pending if change[0] != _DROP_TICKS]

    def take_rescued(self, place: Path) -> int:
        """Take what `rescue` wrote, with the next commit; how many ticks.

        InputError: it cannot be read, or the session went on without it. OSError.
        """
        with reading(place.parent, place.name) as rescued, self._memory:
            rows = {table: list(rescued.whole_rows(table)) for table in TABLES if table != "counts"}
            if any(number <= self._given[table] for table in ("event", "result") for number, *_ in rows[table]):
                raise InputError(f"{place}: the session went on without what is in it")
            for table, found in rows.items():
                for values in found:
                    self._put(table, values)
            for table in NUMBERED:
                self._given[table] = max([self._given[table], *(number for number, *_ in rows[table])])
                self._put("counts", (table, self._given[table], 0))
            self._ticks = max([self._ticks, *(number for number, *_ in rows["ticks"])])
        return sum(count for _, _, _, count, _ in rows["ticks"])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextlib.contextmanager
def new_database(path: Path, sync: bool = True, identity: str = "") -> Iterator[Database]:
    """A new database, to be filled; at the end it takes its place, whole. OSError: it does not, and nothing is left.

    identity: of the session; "": it is a new one.
    """
    identity = identity or uuid.uuid4().hex
    with _as_os_error(path), new_beside(path) as partial:
        with contextlib.closing(sqlite3.connect(partial, isolation_level=None)) as db:
            db.executescript(f"BEGIN; {_SCHEMA}; COMMIT")
            for table, values in (("about", ("identity", json.dumps(identity))), ("counts", (SEALED, 0, 0))):
                db.execute(_PUT[table], (*values, checksum(identity, table, values)))
        database = Database(path.parent, sync, partial.name)
        yield database
        database.close()
        retry_while_locked(os.replace, partial, path)
        if sync:
            sync_folder(path.parent)


def counted(db: sqlite3.Connection) -> dict[str, tuple[int, int]]:
    """Table -> its rows, and the sum of their checksums."""
    of = (table for table in TABLES if table != "counts")
    return {
        table: db.execute(f"SELECT count(*), coalesce(sum(crc), 0) % 4294967296 FROM {table}").fetchone()
        for table in of
    }


# ---------------------------------------------------------------------------------------------------------- to be read


class Stored:
    """What a session's database holds, at one moment."""

    def __init__(self, db: sqlite3.Connection, path: Path) -> None:
        self._db, self.path = db, path
        found = db.execute("SELECT value FROM about WHERE name = 'identity'").fetchone()
        if found is None:
            raise InputError(f"{path}: is damaged (it does not say which session it is)")
        self.identity = str(json.loads(found[0]))

    def rows(self, table: str, where: str = "", *values: Any) -> Iterator[Row]:
        """The rows of a table by their keys. where: an SQL condition on these values."""
        key = TABLES[table][0].split()[0]
        condition = f" WHERE {where}" if where else ""
        with _as_os_error(self.path):
            for *row, crc in self._db.execute(f"SELECT * FROM {table}{condition} ORDER BY {key}", values):
                yield Row(tuple(row), crc == checksum(self.identity, table, row))

    def whole_rows(self, table: str, where: str = "", *values: Any) -> Iterator[tuple]:
        """The same, their values alone. InputError: one was changed."""
        for row in self.rows(table, where, *values):
            if not row.whole:
                raise InputError(f"{self.path}: {table} {row.values[0]!r}: does not match its checksum, it was changed")
            yield row.values

    def last(self, table: str) -> int:
        """The highest number of a table; 0: it is empty."""
        with _as_os_error(self.path):
            return int(self._db.execute(f"SELECT coalesce(max(number), 0) FROM {table}").fetchone()[0])

    def given(self) -> dict[str, int]:
        """The numbers that were given last, also those of rows that are gone: they are not given again."""
        counts = {row.values[0]: row.values[1] for row in self.rows("counts")}
        return {table: max(self.last(table), counts.get(table, 0)) for table in NUMBERED}

    @property
    def is_sealed(self) -> bool:
        """Whether it was closed since it was last written to."""
        return any(row.values[1] for row in self.rows("counts", "name = ?", SEALED))

    def faults(self) -> dict[str, str]:
        """Table -> what is wrong with the number of its rows: some are missing, or were brought in."""
        faults, counts = {}, {}
        for (name, rows, sum_of), whole in self.rows("counts"):
            counts[name] = rows, sum_of
            if not whole:
                faults["counts"] = f"the count of {name} does not match its checksum, it was changed"
        if SEALED not in counts:
            faults["counts"] = "the counts are missing"
        with _as_os_error(self.path):
            there = counted(self._db)
        is_sealed = counts.get(SEALED, (0, 0))[0] == 1
        for table in there if is_sealed else NUMBERED:
            rows, sum_of = counts.get(table, (0, 0))
            numbers = [row.values[0] for row in self.rows(table)] if table in NUMBERED else []
            gap = next((number for number, found in enumerate(numbers, start=1) if number != found), len(numbers) + 1)
            if there[table][0] != rows and table in NUMBERED:
                faults[table] = f"{table} {gap} is missing; {rows} were written, {there[table][0]} are there"
            elif there[table][0] != rows or (is_sealed and there[table][1] != sum_of):
                faults[table] = f"{table}: is not as it was when the session was closed"
        return faults

    def broken_pages(self) -> Iterator[str]:
        """What SQLite itself finds wrong with the file."""
        with _as_os_error(self.path):
            for (problem,) in self._db.execute("PRAGMA integrity_check(10)"):
                if problem != "ok":
                    yield str(problem)


def trials_in(stored: Stored) -> Iterator[tuple[StoredTrial, bool]]:
    """Every trial in the order in which they were begun, and whether it matches its checksum."""
    for values, whole in stored.rows("trial"):
        yield StoredTrial(*values), whole


@contextlib.contextmanager
def reading(folder: Path, name: str = DATABASE) -> Iterator[Stored]:
    """A session's database, to be read: as it is now, whatever is written meanwhile. Nothing is changed.

    FileNotFoundError: there is none. InputError: it is no database of ours, of a later format, or damaged.
    """
    path = folder / name
    if not path.exists():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    with contextlib.ExitStack() as stack:
        try:
            db = stack.enter_context(_connection(path))
        except OSError as error:
            if error.errno not in (errno.ENOENT, errno.EROFS):
                raise
            db = stack.enter_context(_copy_of(path))
        try:
            refuse_format(db, path)
            yield Stored(db, path)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            raise InputError(f"{path}: is damaged ({error})") from None


def refuse_format(db: sqlite3.Connection, path: Path) -> None:
    """InputError unless this program can read the database."""
    form, application = (int(db.execute(f"PRAGMA {name}").fetchone()[0]) for name in ("user_version", "application_id"))
    if application != APPLICATION:
        raise InputError(f"{path}: is no database of PHD")
    if form != FORMAT:
        raise InputError(
            f"{path}: is of format {form}, this version of PHD reads format {FORMAT}: use the version that recorded it"
        )


@contextlib.contextmanager
def _connection(path: Path, mode: str = "ro") -> Iterator[sqlite3.Connection]:
    with contextlib.ExitStack() as stack:
        with _as_os_error(path):
            db = sqlite3.connect(
                f"{path.absolute().as_uri()}?mode={mode}", uri=True, timeout=BUSY_S, isolation_level=None
            )
            stack.enter_context(contextlib.closing(db))
            db.text_factory = lambda text: text.decode(errors="replace")  # damaged: its checksum says so
            db.execute("BEGIN")
            db.execute("PRAGMA user_version").fetchone()
            db.execute("SELECT count(*) FROM sqlite_schema").fetchone()  # from here on it does not change
        yield db


@contextlib.contextmanager
def _copy_of(path: Path) -> Iterator[sqlite3.Connection]:
    """A database that a kill left open, and whose log or journal cannot be brought into it here: read from a copy."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            for file in (path, *(path.with_name(f"{path.name}-{kind}") for kind in ("wal", "journal"))):
                if file.exists():
                    shutil.copyfile(file, Path(folder) / file.name)
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({reason_of(error)})") from None
        with _connection(Path(folder) / path.name, "rw") as db:
            yield db


@contextlib.contextmanager
def _as_os_error(path: Path) -> Iterator[None]:
    """Turn what SQLite says of the disk into an OSError, and what it says of the file into an InputError."""
    try:
        yield
    except UnicodeDecodeError:  # of SQLite's own sentence, which repeats what it has found
        raise InputError(f"{path}: is damaged (what it holds is no text)") from None
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code in (sqlite3.SQLITE_ERROR, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB) or isinstance(
            error, sqlite3.DataError
        ):
            raise InputError(f"{path}: is damaged ({error})") from None
        number = _ERRNO.get(code)
        raise OSError(number or errno.EIO, os.strerror(number) if number else str(error), str(path)) from None
