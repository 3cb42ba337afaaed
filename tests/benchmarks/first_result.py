"""Where the seconds of a study go, from the start of Python to the report.

`python -m tests.benchmarks.first_result [OPERATORS]` prints a line for each part: wall time, and processor time of this
process; in the last line that of the helpers too.
"""

import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

marks: list[tuple[str, float, float]] = []


def mark(part: str) -> None:
    """This part ends now."""
    marks.append((part, time.perf_counter(), time.process_time()))


def marking(call: Callable, part: str) -> Callable:
    """The call, and a mark behind it."""

    def marked(*arguments):
        found = call(*arguments)
        mark(part)
        return found

    return marked


def main() -> None:
    """Run a study and print where its seconds went."""
    operators = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    marks.append(("", time.perf_counter(), 0.0))
    from experiments.protocol import load_protocol
    from experiments.study import study
    from experiments.trial.population import load_population

    mark("Python and imports")
    protocol, population = load_protocol(), load_population("average")
    mark("protocol")
    study.load_kernels = marking(study.load_kernels, "kernels from disk")
    study.write_pooled_table = marking(study.write_pooled_table, "trials, recorded and measured")
    with tempfile.TemporaryDirectory() as folder:
        study.run_study(Path(folder) / "study", operators, protocol, population)
        mark("figures, error bars, report")
    for (_, before, used), (part, wall, cpu) in zip(marks, marks[1:], strict=False):
        print(f"{part:32} {wall - before:6.2f} s   {cpu - used:6.2f} s of a core")
    usage = [resource.getrusage(of) for of in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    whole = sum(one.ru_utime + one.ru_stime for one in usage)
    print(f"{'all, with the helpers':32} {marks[-1][1] - marks[0][1]:6.2f} s   {whole:6.2f} s of a core")


if __name__ == "__main__":
    main()
