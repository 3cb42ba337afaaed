"""`phd ARGS` on many jobs, on two workers, killed as soon as the third job is on the disk: on every machine alike.

python killed_work.py SIGNAL ARGS
Before that it prints the number of every process that descends from it.
"""

import os
import sys
from pathlib import Path

from processes import children

DONE = 3  # jobs


def descendants(pid: int) -> set[int]:
    """Every living process that descends from this one."""
    found, waiting = set(), {pid}
    while waiting:
        waiting = {child for parent in waiting for child in children(parent)} - found
        found |= waiting
    return found


def main(number: int, arguments: list[str]) -> int:
    """The exit code of a run that is not killed."""
    from app.cli import main as phd
    from experiments.study import jobs

    rename, kept = jobs.rename, []

    def rename_and_die(partial: Path, part: Path) -> None:
        rename(partial, part)
        kept.append(part)
        if len(kept) == DONE:
            print(*descendants(os.getpid()), flush=True)
            os.kill(os.getpid(), number)

    jobs.rename = rename_and_die
    jobs.cores = lambda: 2
    sys.argv[1:] = arguments
    return phd()


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    sys.exit(main(int(sys.argv[1]), sys.argv[2:]))
