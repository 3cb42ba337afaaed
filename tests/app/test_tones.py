"""The tones at "go" and at the end of a trial: their sound, when they come, and what plays them."""

import pytest
from fake_client import opened, paper, running, ticks

from core import tick_log


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
