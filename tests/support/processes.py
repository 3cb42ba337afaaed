"""Which processes live, on each system."""

import contextlib
import ctypes
import os
import signal
import sys
from pathlib import Path

if sys.platform == "win32":
    STILL_RUNNING = 258  # WaitForSingleObject: WAIT_TIMEOUT
    SYNCHRONIZE, SUSPEND = 0x100000, 0x800
    PROCESSES = 0x2  # CreateToolhelp32Snapshot: TH32CS_SNAPPROCESS

    class _Entry(ctypes.Structure):
        _fields_ = [
            ("size", ctypes.c_uint32), ("usage", ctypes.c_uint32), ("pid", ctypes.c_uint32), ("heap", ctypes.c_size_t),
            ("module", ctypes.c_uint32), ("threads", ctypes.c_uint32), ("parent", ctypes.c_uint32),
            ("priority", ctypes.c_int32), ("flags", ctypes.c_uint32), ("program", ctypes.c_char * 260),
        ]  # fmt: skip

    def suspend(pid: int) -> None:
        """Let a process hang."""
        kernel32 = ctypes.WinDLL("kernel32")
        kernel32.OpenProcess.restype = ctypes.c_void_p
        ctypes.WinDLL("ntdll").NtSuspendProcess(ctypes.c_void_p(kernel32.OpenProcess(SUSPEND, False, pid)))

    def gone(pid: int) -> bool:
        """Whether a process has ended."""
        kernel32 = ctypes.WinDLL("kernel32")
        kernel32.OpenProcess.restype = ctypes.c_void_p
        handle = ctypes.c_void_p(kernel32.OpenProcess(SYNCHRONIZE, False, pid))
        if not handle:
            return True
        running = kernel32.WaitForSingleObject(handle, 0) == STILL_RUNNING
        kernel32.CloseHandle(handle)
        return not running

    def children(pid: int) -> list[int]:
        """The processes that a process has started and that live."""
        kernel32 = ctypes.WinDLL("kernel32")
        kernel32.CreateToolhelp32Snapshot.restype = ctypes.c_void_p
        every = ctypes.c_void_p(kernel32.CreateToolhelp32Snapshot(PROCESSES, 0))
        entry = _Entry(size=ctypes.sizeof(_Entry))
        found, more = [], kernel32.Process32First(every, ctypes.byref(entry))
        while more:
            helper = entry.program.lower() == b"conhost.exe"  # Windows' own, for a process without a console window
            if entry.parent == pid and entry.pid != pid and not helper and not gone(entry.pid):
                found.append(entry.pid)
            more = kernel32.Process32Next(every, ctypes.byref(entry))
        kernel32.CloseHandle(every)
        return found

else:

    def suspend(pid: int) -> None:
        """Let a process hang."""
        os.kill(pid, signal.SIGSTOP)

    def gone(pid: int) -> bool:
        """Whether a process has ended (one that nobody has waited for yet counts as ended)."""
        try:
            return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] in "ZX"
        except (FileNotFoundError, ProcessLookupError):
            return True

    def children(pid: int) -> list[int]:
        """The processes that a process has started and that live."""
        found: list[int] = []
        with contextlib.suppress(OSError):  # it ends just now
            for file in sorted(Path(f"/proc/{pid}/task").glob("*/children")):
                with contextlib.suppress(OSError):  # or one of its threads
                    found += map(int, file.read_text().split())
        return found
