"""`python tests/support/emulated_firmware.py ..`: `phd emulate ..` with the board in C on an emulated Cortex-M4."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from firmware_board import Pipe, firmware_boards  # noqa: E402
from reference_board import on_a_cortex_m4  # noqa: E402

from app.cli import main  # noqa: E402
from hardware.emulated_board import emulator  # noqa: E402

if __name__ == "__main__":
    processor = Pipe(on_a_cortex_m4())
    emulator.Board = firmware_boards(lambda: processor)  # type: ignore[misc]
    sys.argv[1:1] = ["emulate"]
    try:
        code = main()
    finally:
        processor.close()
    sys.exit(code)
