"""The short tones at "go" and at the end of a trial, played by the system's own player."""

import io
import shutil
import subprocess
import sys
import tempfile
import wave
from functools import cache
from pathlib import Path

import numpy as np
from PySide6.QtCore import QProcess

from app.window.widgets import memory

if sys.platform == "win32":
    import winsound

RATE_HZ, LENGTH_S, FADE_S, LOUDNESS = 44_100, 0.12, 0.01, 0.3
GO_HZ, END_HZ = 880.0, 587.0
#: What plays a file, and what prints something if there is a device for it: of PulseAudio and PipeWire, and of ALSA.
PLAYERS = {"paplay": ("pactl", "info"), "aplay": ("aplay", "-l")}
PATIENCE_S = 1.0  # with a sound server that does not answer
NO_SOUND = "No sound: attach a sound device, and install pulseaudio-utils or alsa-utils."


@cache
def player() -> str | None:
    """The program that plays a file; "" where the system does it; None: tones cannot be heard here. Looked up once."""
    return "" if sys.platform == "win32" else next(filter(None, map(_path_of, PLAYERS)), None)


def _path_of(name: str) -> str | None:
    """Where a player is, if there is a sound device for it."""
    try:
        devices = subprocess.run(PLAYERS[name], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=PATIENCE_S)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return shutil.which(name) if devices.stdout else None


def tone(frequency_Hz: float) -> bytes:
    """A sine with soft ends, as a WAV file."""
    t = np.arange(round(RATE_HZ * LENGTH_S)) / RATE_HZ
    fade = np.minimum(1.0, np.minimum(t, t[::-1]) / FADE_S)
    samples = (32_767 * LOUDNESS * fade * np.sin(2.0 * np.pi * frequency_Hz * t)).astype("<i2")
    file = io.BytesIO()
    with wave.open(file, "wb") as written:
        written.setnchannels(1)
        written.setsampwidth(2)
        written.setframerate(RATE_HZ)
        written.writeframes(samples.tobytes())
    return file.getvalue()


class Tones:
    """Both tones, ready to be played without waiting for anything."""

    def __init__(self) -> None:
        self._player = player()
        self._folder = tempfile.TemporaryDirectory(prefix="phd-tones-", ignore_cleanup_errors=True)  # Windows: playing
        self._files = {}
        for name, frequency in (("go", GO_HZ), ("end", END_HZ)):
            self._files[name] = Path(self._folder.name) / f"{name}.wav"
            self._files[name].write_bytes(tone(frequency))

    def play(self, name: str) -> None:
        """Begin to play "go" or "end", unless the sound is off in the settings; returns at once."""
        if memory.remembered(memory.SOUND) == memory.OFF:
            return
        if sys.platform == "win32":
            winsound.PlaySound(str(self._files[name]), winsound.SND_FILENAME | winsound.SND_ASYNC)
        elif self._player is not None:
            QProcess.startDetached(self._player, [str(self._files[name])])
