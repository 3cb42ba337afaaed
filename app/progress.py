"""What a verb says on stderr while it works: a progress bar on a terminal, a word on the first compilation."""

import os
import sys
import time


def announce_first_use() -> bool:
    """Say so if kernels will be compiled now; whether they will."""
    from core.kernel import first_use

    first = first_use() and os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")
    if first:
        print("compiling kernels (first use, about half a minute)", file=sys.stderr, flush=True)
    return first


class Progress:
    """A progress bar on stderr, on a terminal only, for what takes over a second; called with the share done."""

    CELLS = 30

    def __init__(self, says: str) -> None:
        self.says, self.start, self.shown = says, time.monotonic(), ""

    def __call__(self, share: float) -> None:
        if not sys.stderr.isatty() or time.monotonic() - self.start < 1.0:
            return
        full = round(share * self.CELLS)
        line = f"\r{self.says} [{'#' * full}{'.' * (self.CELLS - full)}] {share:4.0%}"
        if line != self.shown:
            print(line, end="", file=sys.stderr, flush=True)
            self.shown = line

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_: object) -> None:
        if self.shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
