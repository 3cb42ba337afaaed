"""The tones: files that any player takes, of the frequency that they name, with soft ends."""

import io
import wave

import numpy as np
import pytest
from fake_client import opened, paper, ready, running, ticks
from screens import Screens

from app.window.tone import END_HZ, GO_HZ, RATE_HZ, tone
from core import tick_log


@pytest.mark.parametrize("frequency", [GO_HZ, END_HZ])
def test_a_tone_has_its_frequency_and_no_click_at_its_ends(frequency: float) -> None:
    with wave.open(io.BytesIO(tone(frequency))) as file:
        assert file.getframerate() == RATE_HZ and file.getnchannels() == 1
        samples = np.frombuffer(file.readframes(file.getnframes()), "<i2").astype(float)
    spectrum = np.abs(np.fft.rfft(samples))
    assert np.argmax(spectrum) * RATE_HZ / len(samples) == pytest.approx(frequency, abs=RATE_HZ / len(samples))
    assert abs(samples[[0, -1]]).max() < 0.02 * abs(samples).max()


@pytest.mark.parametrize("on", [True, False])
def test_tones_come_at_go_and_at_the_end_once_each_and_only_where_the_protocol_has_them(
    screens: Screens, monkeypatch, on: bool
) -> None:
    played: list[str] = []
    monkeypatch.setattr(screens.participant.tones, "play", played.append)
    screens.hear(opened(protocol=paper(tones=on)), running())
    screens.participant.show()
    for phase in (tick_log.APPROACH, tick_log.HOLD, tick_log.MOVE, tick_log.MOVE, tick_log.END, tick_log.END):
        screens.tick(ticks(phase))
    assert played == (["go", "end"] if on else [])


def test_tones_that_cannot_be_heard_are_named_to_the_experimenter(screens: Screens, monkeypatch) -> None:
    monkeypatch.setattr("app.window.session_panel.player", lambda: None)
    screens.hear(opened(protocol=paper(tones=True)), ready(1))
    assert "no program to play them" in screens.run.panel.notice.text()
    screens.hear(opened(protocol=paper(tones=False)), ready(1))
    assert not screens.run.panel.notice.isVisible()
