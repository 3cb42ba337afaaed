"""The tones at "go" and at the end of a trial: their sound, when they come, and what plays them."""

import io
import sys
import wave
from pathlib import Path

import numpy as np
import pytest
from fake_client import opened, paper, running, ticks

from app.window.participant.tone import END_HZ, GO_HZ, RATE_HZ, player, tone
from core import tick_log


@pytest.mark.parametrize("frequency", [GO_HZ, END_HZ])
def test_a_tone_has_its_frequency_and_no_click_at_its_ends(frequency: float) -> None:
    with wave.open(io.BytesIO(tone(frequency))) as file:
        assert file.getframerate() == RATE_HZ and file.getnchannels() == 1
        samples = np.frombuffer(file.readframes(file.getnframes()), "<i2").astype(float)
    spectrum = np.abs(np.fft.rfft(samples))
    assert np.argmax(spectrum) * RATE_HZ / len(samples) == pytest.approx(frequency, abs=RATE_HZ / len(samples))
    assert abs(samples[[0, -1]]).max() < 0.02 * abs(samples).max()


@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize("on", [True, False])
def test_tones_come_at_go_and_at_the_end_once_each_and_only_where_the_protocol_has_them(screens, monkeypatch, on, seen):
    played: list[str] = []
    monkeypatch.setattr(screens.participant.tones, "play", played.append)
    screens.hear(opened(protocol=paper(tones=on)), running())
    screens.participant.setVisible(seen)
    for phase in (tick_log.APPROACH, tick_log.HOLD, tick_log.MOVE, tick_log.MOVE, tick_log.END, tick_log.END):
        screens.tick(ticks(phase))
    assert played == (["go", "end"] if on else [])


@pytest.mark.skipif(sys.platform == "win32", reason="Windows plays itself")
def test_a_player_is_one_that_reaches_a_sound_device(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    for program, says, found in (
        ("paplay", "", None),
        ("pactl", ">&2", None),
        ("aplay", ">&2", None),
        ("aplay", "", "aplay"),
    ):
        (tmp_path / program).write_text(f"#!/bin/sh\necho a device {says}\n")
        (tmp_path / program).chmod(0o755)
        player.cache_clear()
        assert player() == (found and str(tmp_path / found)), (program, says)
    player.cache_clear()
