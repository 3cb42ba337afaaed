"""The sentences of the screens: the participant's from the language of the protocol, the experimenter's here."""

import math
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

from PySide6.QtCore import QLocale

from app.ipc import messages as m
from app.window.widgets import palette
from app.window.widgets.theme import shade
from core import tick_log
from core.control.controllers import Preset
from experiments.analysis.trials_table import TrialRow
from experiments.inputs import INPUTS
from experiments.language import ENGLISH_WORDS, Language
from experiments.plan import PlannedTrial
from experiments.store.cells import trial_name
from experiments.store.database import DATABASE

GAIN = "gain_N_s_m"


class Shown(NamedTuple):
    """What the participant reads: one large line, a quiet one under it."""

    large: str
    small: str = ""


#: Until the session server has said what there is.
PREPARING = Shown("One moment", "Everything is being prepared")


#: phase, stage -> keys of the language: of the large line, of the quiet one
PHASES = {
    tick_log.APPROACH: ("approach", "approach_how"),
    tick_log.HOLD: ("hold", "hold_how"),
    tick_log.MOVE: ("go", "go_how"),
}
STAGES = {
    m.PREPARING: ("preparing", "preparing_how"), m.NO_SESSION: ("welcome", "start_soon"),
    m.RERIG: ("change", "change_how"), m.BREAK: ("break", "break_how"), m.QUESTIONS: ("questions", ""),
    m.FINISHED: ("finished", "finished_how"), m.FAILED: ("failed", "failed_how"),
}  # fmt: skip
#: stage -> what the experimenter reads in large letters
HEADS = {
    m.PREPARING: "One moment", m.NO_SESSION: "No session", m.RERIG: "Not ready", m.BREAK: "Break",
    m.QUESTIONS: "Questions", m.FINISHED: "Finished", m.FAILED: "Stopped",
}  # fmt: skip
#: status of a trial -> key of the language
ENDINGS = {
    "done": "done", "timeout": "timeout", "aborted": "stopped", "recovered": "stopped", "stopped": "stopped",
    "redone": "again", "excluded": "again", "skipped": "skipped",
}  # fmt: skip

RESUME = "Start again and resume the session"
KEPT = "What had reached its file is kept."
LEAVE = "What is recorded stays, and Home resumes the session where it stands."
LACKING = "Without a result: aborted (×), skipped (–) or excluded (e)"

#: status of a trial, in the tables -> on the screen
STATUS_WORDS = {"timeout": "time was up", "redone": "repeated", "stopped": "cut short"}


def server_died(last: m.Snapshot, plan: Sequence[PlannedTrial] = ()) -> str:
    """What a session server that is gone leaves behind. last: the newest that it has sent; plan: of its session."""
    if last.stage == m.FAILED and last.notice:  # it said so itself
        return last.notice
    kept = f"What it had only in its memory is lost: {last.in_memory}." if last.in_memory else KEPT
    if last.running is None:
        return f"The session server has stopped: the brakes are off. {kept} {RESUME}."
    trial = "a practice trial" if last.practice else trial_name(last.running, plan, last.rows)
    stopped = f"The session server has stopped in the middle of {trial}: the brakes are off."
    return f"{stopped} {kept} {RESUME}: it comes again."


def language_of(opened: m.Opened | None) -> Language:
    """The participant's language; English before there is a protocol."""
    return opened.protocol.sentences if opened is not None else ENGLISH_WORDS


GO_S = 1.0  # that "Go" stands in large letters: then nothing draws the eye from the path


def moving(
    phase: int, taken: bool, language: Language, left_early: bool = False, seen: bool = True, since_s: float = 0.0
) -> Shown:
    """The lines of a phase of a trial, and while it is being written. left_early: the start was left before "go".

    seen: the handle is in sight; else the participant is not asked to touch it. since_s: how long the phase has lasted.
    """
    if phase not in PHASES:
        return Shown(language["preparing"])
    large, small = PHASES[phase]
    if not taken:
        small = "take" if seen else "stopped_how"
    elif left_early:
        small = "hold_again"
    told = "" if phase == tick_log.MOVE and since_s > GO_S else language[large]
    return Shown(told, language[small].format(handle=language[palette.chosen.handle_name]))


def between(snapshot: m.Snapshot, opened: m.Opened | None, own_start: bool = False) -> Shown:
    """The lines while no trial runs. own_start: the person who reads them has the space bar."""
    language = language_of(opened)
    if snapshot.stage in STAGES or snapshot.card is not None or snapshot.paused:
        stage = snapshot.stage if snapshot.stage in STAGES else m.BREAK if snapshot.card is None else m.RERIG
        if snapshot.card is not None and snapshot.card.participant:
            return Shown(snapshot.card.participant)
        large, small = STAGES[stage]
        first = feedback(snapshot, opened) if stage in (m.RERIG, m.BREAK, m.FINISHED) else ""
        return Shown(language[large], " · ".join(filter(None, (first, language.get(small, "")))))
    if snapshot.brakes_off:
        return Shown(language["stopped"], language["stopped_how"])
    blocked = bool(snapshot.trial_blocker)
    row = snapshot.newest
    if row is None:
        large, space = ("welcome_back", "next_space") if snapshot.rows else ("welcome", "first_space")
        return Shown(language[large], language["stopped_how" if blocked else space if own_start else "start_soon"])
    follows = language["next_space" if own_start and not blocked else "stopped_how"]
    return Shown(language[ENDINGS[row.status]], " · ".join([*given_back(row, opened), follows]))


def with_keys(shown: Shown, snapshot: m.Snapshot, language: Language) -> Shown:
    """The lines while no trial runs, for a user who sees the participant's window alone: which keys lead on."""
    allow = language["brakes_key"] if snapshot.brakes_off and snapshot.stage != m.FAILED else ""
    waits = shown.small if not allow or shown.small != language["stopped_how"] else ""  # there is no one to wait for
    return shown._replace(small=" · ".join(filter(None, (waits, allow, language["main_key"]))))


def feedback(snapshot: m.Snapshot, opened: m.Opened | None) -> str:
    """What the protocol gives back of the newest trial, where something else is shown after it; "": nothing."""
    return " · ".join(given_back(snapshot.newest, opened)) if snapshot.newest is not None else ""


def given_back(trial: TrialRow, opened: m.Opened | None) -> list[str]:
    """Feedback and cue after a trial, as far as the protocol gives them and the trial was done."""
    if opened is None or trial.status != "done":
        return []
    protocol, language, parts = opened.protocol, opened.protocol.sentences, []
    duration_s, error_m = trial.value("duration_s"), trial.value("path_error_m")
    if protocol.feedback == "time" and duration_s is not None:
        parts.append(language["time"].format(seconds=f"{duration_s:.1f}"))
    if protocol.feedback == "error" and error_m is not None:
        parts.append(language["error"].format(mm=f"{1e3 * error_m:.1f}"))
    if protocol.cues is not None and duration_s is not None:
        if duration_s < protocol.cues.too_fast_s:
            parts.append(language["slower"])
        elif duration_s > protocol.cues.too_slow_s:
            parts.append(language["faster"])
    return parts


# ---------------------------------------------------------------------------------------------- for the experimenter


def head_of(snapshot: m.Snapshot, wrong: bool) -> str:
    """Where the session stands while no trial runs. wrong: the banner says what is."""
    large = HEADS.get(snapshot.stage, "Paused" if snapshot.paused else "Ready")
    if snapshot.stage == m.FAILED:
        return large
    if snapshot.can_allow:
        return "Brakes off"
    return "Not ready" if wrong or (large == "Ready" and snapshot.trial_blocker) else large


def ended(row: TrialRow) -> str:
    """How a trial ended: "done in 2.4 s"."""
    duration_s = row.value("duration_s")
    took = f" in {duration_s:.1f} s" if duration_s is not None else ""
    return {"done": f"done{took}", "timeout": "ended: time was up"}.get(row.status, row.status)


def cell(planned: PlannedTrial | TrialRow, opened: m.Opened, blind: bool) -> str:
    """Controller and path of a trial; the controller is left out while blind."""
    path = f"path {planned.path}"
    return path if blind else f"{opened.protocol.controller_name(planned.controller)} · {path}"


def describe(planned: PlannedTrial | TrialRow, opened: m.Opened, blind: bool) -> str:
    return f"{planned.configuration} · {cell(planned, opened, blind)}"


def to_go(left: int, planned: int, lacking: int) -> str:
    """How far a session is: trials of the plan that are left; those that are over without a result."""
    said = f"{left} of {planned} trials to go" if left else f"All {planned} trials are over"
    return said + (f" · {lacking} without a result" if lacking else "")


def minutes(seconds: float | None) -> str:
    """About how long: "about 14 min left"; empty while that is unknown."""
    if seconds is None:
        return ""
    return f"about {max(math.ceil(seconds / 60.0), 1)} min left"


def clock(seconds: float) -> str:
    """2:05 for 125 s."""
    whole = max(int(seconds + 0.999), 0)
    return f"{whole // 60}:{whole % 60:02d}"


def measured(value: float | None) -> str:
    """A measure of a trial, in two digits or more; a dash: there is none."""
    return "–" if value is None else f"{value:.{int(value < 10.0)}f}"


def in_colour(text: str, colour: str) -> str:
    """A text as HTML; no line ends within a unit such as m/s."""
    return f'<span style="color: {shade(colour).name()}">{escape(text)}</span>'.replace("m/s", "m/\u2060s")


def size(count: int) -> str:
    """Bytes as kB, MB or GB."""
    return QLocale.c().formattedDataSize(count, 1, QLocale.DataSizeFormat.DataSizeSIFormat)


def from_home(folder: Path) -> str:
    """A folder as ~/data where it lies below the user's home."""
    home = Path.home()
    return f"~/{folder.relative_to(home)}" if folder.is_relative_to(home) else str(folder)


def as_sentence(text: str) -> str:
    """With a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:].removesuffix('.')}."


def data_folder_of(folder: Path) -> Path:
    """A folder that was chosen; of a session the data folder that holds it."""
    return folder.parent.parent if (folder / DATABASE).exists() else folder


def hand_is_mouse(opened: m.Opened | None) -> bool:
    """Whether the pointer is the hand (until it is known what is, yes: the pointer does nothing then)."""
    return opened is None or INPUTS[opened.hand].by_pointer


def feel(preset: Preset, controllers: Mapping[int, Preset]) -> str:
    """What a controller feels like among those of its protocol."""
    gap, gain = preset.value("gap_m"), preset.value(GAIN)
    free = f"{1e3 * gap:g} mm free to each side"
    gains = [preset.value(GAIN) for preset in controllers.values() if preset.kind == "proportional"]
    if preset.kind == "none":
        return "only the brakes' own drag"
    if preset.kind == "sdof":
        return f"on rails, {free}" if gap else "as on rails"
    if preset.kind == "proportional":
        name = "a strong guide" if gain >= max(gains) else "a weak guide" if gain <= min(gains) else "a guide"
        return f"{name}, {free}" if gap else name
    return preset.words
