"""The work of a folder with many sessions rises with their number, and that of a trial does not rise with it."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from protocols import short
from sessions import new_session, run_trials

from experiments.export.results import read_results
from experiments.store.files import pooled_rows
from experiments.store.overview import scan_folder
from experiments.store.verify import verify

FEW, MANY = 5, 20
COUNTED = {"open", "sqlite3.connect", "os.listdir", "os.scandir"}
_seen: list[str] = []
_is_counting = [False]


def _count(event: str, _: tuple) -> None:
    if _is_counting[0] and event in COUNTED:
        _seen.append(event)


sys.addaudithook(_count)


def work_of(do: Callable[[], object]) -> int:
    """How many files, folders and databases are opened for it."""
    _seen.clear()
    _is_counting[0] = True
    try:
        do()
    finally:
        _is_counting[0] = False
    return len(_seen)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Data folders with one session, few and many: with the first, whatever is read once is read."""
    made = []
    for count in (1, FEW, MANY):
        data = tmp_path_factory.mktemp("sessions") / "data"
        for number in range(1, count + 1):
            new_session(data, f"{number:03d}", short()).close()
        made.append(data)
    return made


@pytest.mark.parametrize("read", [scan_folder, pooled_rows, read_results, verify])
def test_a_folder_is_read_in_work_that_rises_as_its_sessions_do(folders, read):
    read(folders[0])
    few, many = (work_of(lambda data=data: read(data)) for data in folders[1:])
    assert few < many <= 1.05 * MANY / FEW * few, (few, many)


def test_a_trial_costs_the_same_beside_however_many_sessions(folders):
    work = []
    for data in folders:
        session = new_session(data, "999", short())
        run_trials(session, 1)
        work.append(work_of(lambda session=session: run_trials(session, 1)))
        session.close()
        assert not (data / "trials.csv").exists(), "a pooled table is a study's, and made at its end"
    assert work[1] == work[2]
