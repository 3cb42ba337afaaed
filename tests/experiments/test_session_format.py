"""The queries of docs/files-and-commands.md run on a session as they stand there."""

import re
import sqlite3
from contextlib import closing
from pathlib import Path

from protocols import short
from sessions import closed_session

PAGE = Path(__file__).resolve().parents[2] / "docs" / "files-and-commands.md"


def test_the_queries_of_the_page_give_the_events_and_the_measures(tmp_path: Path) -> None:
    closed_session(tmp_path, 1, protocol=short(paths=1))
    queries = re.findall(r"```sql\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[:2]
    with closing(sqlite3.connect(tmp_path / "sub-01" / "ses-01" / "session.db")) as database:
        events, measures = (database.execute(query).fetchall() for query in queries)
    assert events[0][2] == "created" and len(measures) == 1 and measures[0][1] == "done" and measures[0][2] > 0.0
