"""Home: choices that take effect when a session starts, what keeps it from starting, and the data that are there."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from fake_client import GREEN, RED, before, opened, ready, running
from own_files import put_code
from page_driver import PageDriver
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QPushButton
from screens import settle
from sessions import closed_session
from status_messages import ON_BENCH, WELL
from texts_on_screen import faults

from app.ipc import messages as m
from app.window.home.home_page import BOARD, SIMULATED, HomePage
from app.window.widgets.page import ANALYSE, RUN
from app.window.widgets.parts import Segments
from experiments.inputs import MOUSE, OPERATOR
from experiments.protocol import PAPER, load_protocol
from experiments.store.overview import DataOverview, SessionOverview
from hardware.discovery import BoardFound

FORM = '\n[form]\nhandedness = ["right", "left"]\nage = "number"\n'
SUMMARY = "The experiment of the paper\n2 devices × 5 controllers × 2 paths × 3 = 60 trials, about 20\u00a0min"


class Shown(PageDriver):
    """A home page on a data folder."""

    def __init__(self, folder: Path) -> None:
        super().__init__(HomePage)
        self.setup = m.Setup(folder)
        self.page.show_setup(self.setup)
        self.page.show_opened(opened(""))
        self.page.show_snapshot(before())
        self.wait()

    def wait(self) -> None:
        """Until the chosen protocol and the data folder have been read."""
        self.until(lambda: self.page.loaded is not None and self.page.data.overview is not None)

    def look(self, *sessions: SessionOverview, operators: int = 0) -> None:
        """The data folder holds these."""
        self.page.data.show_overview(DataOverview(self.setup.data_dir, sessions, operators))
        self.page.show_snapshot(self.page.snapshot)


@pytest.fixture
def shown(tmp_path: Path) -> Iterator[Shown]:
    made = Shown(tmp_path / "data")
    yield made
    made.close()


def button_of(segments: Segments, text: str) -> QPushButton:
    return next(button for button in segments.findChildren(QPushButton) if button.text() == text)


def session(folder: Path, participant: str, done: int, of: int = 60) -> SessionOverview:
    return SessionOverview(folder / f"sub-{participant}" / "ses-01", participant, "paper", done, of, 1.7e9)


class Seen(NamedTuple):
    """What Home shows of a data folder, an open session and a name that is typed, and what its button does then."""

    reads: str = ""  # all of these can be read
    start: str = ""  # the words of the button
    sends: list | None = None  # what it sends; None: it cannot be pressed
    said: m.Snapshot = before()
    sessions: tuple[tuple[str, int], ...] = ()  # in the folder, the newest first: participant, trials done
    changes: dict[str, Any] = {}  # noqa: RUF012  (never changed) of the newest of them
    operators: int = 0
    typed: str = ""  # the participant
    open: str = ""  # whose session
    dead: str = ""  # buttons that cannot be pressed, with the reason


NEW, BEGUN = "Start session   01 · 60 trials", (("02", 14), ("01", 60))
OPEN_01 = {"start": "Go to the session   01", "sends": [], "open": "01", "sessions": (("02", 14), ("01", 3))}
IN_SESSION = "The session of 01 is open: close it"
STUDY = "holds a study of 3 simulated operators"
HOME = {
    "new": Seen(f"{SUMMARY} | No sessions yet | new participant", NEW, [m.Open("01")]),
    "red": Seen(" | ".join(check.advice for check in RED if check.state == m.BAD), NEW, said=before(checks=RED)),
    "preparing": Seen("Waiting for the session server", NEW, said=m.Snapshot(m.PREPARING)),
    "refused": Seen("participant 01: exists already", NEW, [m.Open("01")],
                    before(notice="participant 01: exists already", notice_bad=True)),
    "with blanks": Seen("new participant", "Start session   07 · 60 trials", [m.Open("07")], typed=" 07 "),
    "a study": Seen(
        f"Study of 3 simulated operators · 3 sessions · 180 of 180 trials | 60 of 60 | {STUDY}",
        "Start session   04 · 60 trials", sessions=(("03", 60), ("02", 60), ("01", 60)), operators=3, typed="04",
    ),
    "without a result": Seen("60 of 60 | 3 without a result", sessions=(("02", 60),), changes={"lacking": 3},
                             start="Open session   02 · complete", sends=[m.Open("02", resume=True)], typed="02"),
    "begun": Seen("14 of 60 done, paper protocol", "Resume session   02 · 46 trials left", [m.Open("02", resume=True)],
                  sessions=BEGUN, typed="02"),
    "by their own protocol": Seen("Participant 02 goes on by their own protocol, mine.",
                                  "Resume session   02 · 46 trials left", [m.Open("02", resume=True)], sessions=BEGUN,
                                  changes={"protocol": "mine"}, typed="02"),
    "done": Seen("60 of 60 done", "Open session   01 · complete", [m.Open("01", resume=True)], sessions=BEGUN,
                 typed="01"),
    "declined": Seen("does not take part", "Start session", sessions=BEGUN, changes={"declined": True}, typed="02"),
    "in a trial": Seen(IN_SESSION, **OPEN_01, said=running(3), dead="Resume | Close"),
    "in a session": Seen(IN_SESSION, **OPEN_01, said=ready(3), dead="Resume"),
}  # fmt: skip


@pytest.mark.parametrize("state", HOME)
def test_what_can_be_read_and_started_in_each_state(shown: Shown, state: str) -> None:
    page, seen = shown.page, HOME[state]
    if seen.open:
        page.show_opened(opened(seen.open))
    page.show_snapshot(seen.said)
    newest, *others = [session(shown.setup.data_dir, who, done) for who, done in seen.sessions] or [None]
    if newest is not None:
        shown.look(newest._replace(**seen.changes), *others, operators=seen.operators)
    if seen.typed:
        shown.type(page.participant, seen.typed)
    settle(page)
    text = shown.texts()
    assert faults(page) == []
    assert all(words in text for words in filter(None, seen.reads.split(" | "))), text
    assert page.start.text() == seen.start and page.start.isEnabled() == (seen.sends is not None)
    assert page.protocol.isEnabled() == (not seen.open)
    buttons = [button for button in page.data.findChildren(QPushButton) if button.isVisible()]
    dead = {button.text() for button in buttons if not button.isEnabled()} & {"Resume", "Close"}
    assert dead == set(filter(None, seen.dead.split(" | ")))
    if seen.sends is not None:
        shown.click(page.start)
        assert shown.sent == seen.sends and shown.pages == ([(RUN, None)] if seen.open else [])


def test_each_session_of_the_folder_leads_to_what_comes_of_it(shown: Shown) -> None:
    page, folder = shown.page, shown.setup.data_dir
    done, begun = session(folder, "01", 60), session(folder, "02", 14)

    def press(text: str, *sessions: SessionOverview) -> None:
        def found() -> list[QPushButton]:
            shown.look(*sessions)  # whatever was found in the folder itself meanwhile
            settle(page)
            return [b for b in page.data.findChildren(QPushButton) if b.isVisible() and b.text() == text]

        shown.until(lambda: bool(found()))
        shown.click(found()[0])

    earlier = session(folder, "03", 5)
    for text in ("Resume", "Results", "All results"):
        press(text, begun, done, earlier)
    assert shown.sent == [m.Open("03", resume=True)] and "Opening …" in shown.texts()
    assert shown.pages == [(ANALYSE, done.folder), (ANALYSE, folder)]
    page.show_snapshot(before(notice="refused", notice_bad=True))
    shown.type(page.participant, "02")
    assert not page.blind.isEnabled(), "of a session that is there this was settled when it began"
    page.show_opened(opened("01"))
    page.show_snapshot(ready(3))
    press("Close", session(folder, "01", 3))
    assert shown.pages[2:] == [(RUN, m.Leave())] and len(shown.sent) == 1, "Run asks first"


def test_another_choice_starts_another_session_server_only_when_the_session_starts(shown: Shown) -> None:
    page = shown.page
    assert page.devices.isHidden() and page.hand.isHidden(), "what is as usual is behind More"
    shown.click(page.more)
    page.protocol.setCurrentIndex(page.protocol.findText("Displays"))
    page.protocol.activated.emit(page.protocol.currentIndex())
    page.hand.setCurrentIndex(page.hand.findText("Simulated operator"))
    page.hand.activated.emit(page.hand.currentIndex())
    page.devices.setCurrentIndex(page.devices.findText("four-brake"))
    page.devices.activated.emit(page.devices.currentIndex())
    shown.wait()
    assert "1 device × " in page.summary.text()
    shown.click(page.more)
    assert "no person is needed" in shown.texts() and not page.devices.isHidden()
    assert not page.blind.isEnabled() and not page.blind.isChecked()  # there is nobody to be blind
    assert shown.setups == [] == shown.sent
    page.show_snapshot(before(checks=(GREEN[0], m.Check("Hand", m.BAD, "no six-axis device"), *GREEN[2:])))
    shown.click(page.start)
    chosen = shown.setup._replace(protocol="displays", hand=OPERATOR, devices=("four-brake",))
    assert shown.setups == [(chosen, m.Open("01"))] and shown.sent == []
    assert page.start.text() == "Opening the session of 01 …" and not page.start.isEnabled()
    page.show_setup(chosen)
    page.show_snapshot(before(notice="not now", notice_bad=True))
    shown.wait()
    shown.click(page.start)
    assert shown.sent == [m.Open("01")], "the session server is the chosen one now"


def test_a_protocol_that_cannot_be_run_starts_nothing_and_the_form_of_one_comes_with_the_session(
    shown: Shown, tmp_path: Path
) -> None:
    page, file = shown.page, tmp_path / "mine.toml"
    file.write_text(load_protocol(PAPER).text.replace("blocks = 3", "blocks = 0"))
    page.take_protocol(str(file))
    shown.wait()
    assert "blocks must be at least 1" in page.summary.text().replace("\u200b", "") and not page.start.isEnabled()
    file.write_text(load_protocol(PAPER).text + FORM)
    page.take_protocol(str(file))
    shown.wait()
    assert not page.start.isEnabled() and page.why.text() == "Fill in handedness.\nFill in age."
    page.participant.setFocus()
    QTest.keyClick(page.participant, Qt.Key.Key_Tab)
    assert page.form.isAncestorOf(page.focusWidget()), "the form stands below the participant, and comes after it"
    for hand, asked in ((OPERATOR, False), (MOUSE, True)):
        page.hand.fill({hand: hand}, hand)
        page.hand.activated.emit(0)
        shown.wait()
        assert page.form.isVisible() == page.why.text().startswith("Fill in") == asked, hand
    shown.click(button_of(page.form.fields["handedness"], "right"))
    shown.type(page.form.fields["age"], "old")
    assert page.why.text() == "Age must be a number."
    shown.type(page.form.fields["age"], "27")
    QTest.keyClick(page.form.fields["age"], Qt.Key.Key_Return)
    ((_, command),) = shown.setups
    assert command == m.Open("01", form={"handedness": "right", "age": 27.0})


def test_what_was_changed_in_one_protocol_is_not_lost_unasked_where_another_is_to_be_edited(shown: Shown) -> None:
    page, editor = shown.page, shown.page.editor
    shown.click(page.edit)
    editor.text.appendPlainText("# mine")
    shown.page.to_close()()
    page.take_protocol("displays")
    shown.click(page.edit)
    assert page.stack.currentWidget() is page.columns and "Paper protocol, a copy: its changes" in shown.texts()
    page.cards.question.buttons[0].click()
    assert page.stack.currentWidget() is editor and "# mine" in editor.text.toPlainText()
    page.to_close()()
    shown.click(page.edit)
    page.cards.question.buttons[1].click()
    assert 'name = "displays"' in editor.text.toPlainText() and not editor.changed


def test_the_plan_is_shown_before_anyone_sits_down_and_a_blind_one_in_codes(shown: Shown) -> None:
    """Of the participant who is named, by their own session where there is one."""
    page, folder, plan = shown.page, shown.setup.data_dir, shown.page.plan.toPlainText
    shown.until(lambda: plan().count("path 1") == 30 and "re-rig to" in plan())
    first = plan()
    assert first.startswith("three-brake") and "SDOF with gap" in first
    shown.type(page.participant, "02")
    shown.until(lambda: plan().startswith("four-brake"))
    page.blind.click()
    shown.until(lambda: "K5" in plan())
    assert not any(
        preset.name in plan() for preset in load_protocol(PAPER).controllers.values() if preset.name != "No control"
    )
    closed_session(folder, 1, participant="02", protocol=load_protocol(PAPER, seed=9), blind=True)
    page.blind.click()
    shown.until(lambda: "of 60 done" in page.standing.text() and plan().count("K") == 60)
    shown.type(page.participant, "P-1")
    shown.until(lambda: plan() == "")


def test_a_board_is_reached_by_its_port_and_no_session_starts_before(shown: Shown, monkeypatch) -> None:
    page = shown.page
    found = (BoardFound("/dev/ttyACM0", device="three-brake"), BoardFound("/dev/ttyUSB1", problem="no answer"))
    monkeypatch.setattr("app.window.home.board_ports.scan_ports", lambda before, mine: found if not mine else ())
    shown.click(button_of(page.link, BOARD))
    shown.until(lambda: "/dev/ttyUSB1" in shown.texts())
    assert "answers, three-brake" in shown.texts()
    shown.until(lambda: "No board is connected" in page.why.text())
    assert not page.start.isEnabled() and page.start.isVisible()
    assert not {"simulated", "mouse"} & set(page.checks.text().split()), "they are not the board's"
    assert not page.ports.connect_typed.isEnabled(), "no port is typed"
    shown.type(page.ports.port, "/tmp/port")
    assert page.ports.connect_typed.isEnabled()
    QTest.keyClick(page.ports.port, Qt.Key.Key_Return)
    chosen = shown.setup._replace(link="/tmp/port")
    assert shown.setups == [(chosen, None)]
    assert page.ports.connect_typed.text() == "Opening …" and not page.ports.connect_typed.isEnabled()
    page.show_setup(chosen)
    shown.wait()
    assert "Opening …" in shown.texts() and "connected" not in shown.texts(), "the server has not said so"
    page.show_opened(opened("", **ON_BENCH))
    page.show_snapshot(before(checks=(m.Check("Device", m.DUE, "not homed yet"), *WELL[1:])))
    assert "connected" in shown.texts() and page.start.isEnabled(), "the first steps of the session home the encoders"
    shown.click(button_of(page.link, SIMULATED))
    assert shown.setups[-1] == (shown.setup, None), "the board is let go"


def test_code_out_of_a_sessions_folder_is_asked_about_before_the_session_goes_on(shown: Shown) -> None:
    page, folder = shown.page, shown.setup.data_dir
    put_code(closed_session(folder, 0).folder, "of home")
    shown.look(session(folder, "01", 14))
    shown.type(page.participant, "01")
    for place, sent in ((0, []), (1, [m.Open("01", resume=True)])):
        shown.click(page.start)
        assert "odd.py" in page.cards.question.text.text() and not shown.sent
        page.cards.question.buttons[place].click()
        assert shown.sent == sent
    page.show_snapshot(before(notice="No.", notice_bad=True))
    shown.click(page.start)
    assert page.cards.question is None and len(shown.sent) == 2, "that answer is remembered"


def test_who_is_named_is_proposed_session_or_not_and_after_it_the_first_without_one(shown: Shown) -> None:
    page, folder = shown.page, shown.setup.data_dir
    (folder / "sub-01" / "ses-01").mkdir(parents=True)
    page.show_setup(shown.setup._replace(participant="01"))
    shown.wait()
    assert page.participant.text() == "01"
    for participant in ("01", ""):
        page.show_opened(opened(participant))
    shown.wait()
    assert page.participant.text() == "02" and page.setup == page.chosen


def test_an_export_runs_beside_the_window_and_says_where_it_is(shown: Shown, tmp_path: Path) -> None:
    data, folder = shown.page.data, shown.setup.data_dir
    closed_session(folder, 2)
    shown.look(session(folder, "01", 2))
    thousandths: list[int] = []
    data.export_task.progressed.connect(thousandths.append)

    def export(says: str) -> None:
        data.export("csv", tmp_path)
        assert data.bar.isVisible() and "Exporting as CSV" in shown.texts() and not data.export_as.isEnabled()
        shown.until(lambda: not data.export_task.busy and data.bar.isHidden())
        assert says in shown.texts()

    (tmp_path / "data-csv-1").mkdir()
    export(f"Exported to {tmp_path / 'data-csv-2'}")
    assert data.show_export.isVisible() and (tmp_path / "data-csv-2" / "trials.csv").exists()
    assert thousandths[-1] == 1000
    data.show_folder(tmp_path / "none")
    export("Nothing was exported: ")
    assert "there is no such folder" in shown.texts() and not data.show_export.isVisible()


def test_consent_comes_before_the_form_and_who_declines_is_asked_nothing_else(shown: Shown, tmp_path: Path) -> None:
    page, file = shown.page, tmp_path / "mine.toml"
    file.write_text(f'{load_protocol(PAPER).text}{FORM}[consent]\ntext = "You may stop."\nagree = "Yes"\n')
    page.take_protocol(str(file))
    shown.until(lambda: page.start.text() == "Ask 01 for consent")
    assert page.form.isHidden() and page.start.isEnabled()
    page.show_setup(page.chosen)  # the session server that is there has this protocol
    page.show_opened(opened(""))
    page.show_snapshot(before())
    shown.click(page.start)
    assert "You may stop." in shown.texts() and "Consent of 01" in shown.texts() and page.consent.agree.text() == "Yes"
    shown.click(page.consent.decline)
    (declined,) = shown.sent
    assert declined.participant == "01" and not declined.consent[0] and declined.form == {} and not declined.blind
    shown.look(SessionOverview(tmp_path, "01", "mine", 0, 0, 1.7e9, declined=True))
    assert not page.start.isEnabled() and "01 does not take part" in page.why.text()
    shown.wait()
    shown.type(page.participant, "02")
    shown.click(page.start)
    shown.click(page.consent.agree)
    assert page.form.isVisible() and "Fill in age." in page.why.text()
    page.form.fields["handedness"].show_value("right")
    page.form.fields["age"].setText("30")
    page.form.changed.emit()
    shown.click(page.start)
    agreed = shown.sent[-1]
    assert agreed.consent[0] and agreed.form == {"handedness": "right", "age": 30.0}


def test_consent_is_asked_on_the_participants_own_screen_where_there_is_one(shown: Shown, tmp_path: Path) -> None:
    page, asked = shown.page, []
    page.consent_asked.connect(asked.append)
    page.participant_answers = True
    (tmp_path / "mine.toml").write_text(f'{load_protocol(PAPER).text}[consent]\ntext = "You may stop."\n')
    page.take_protocol(str(tmp_path / "mine.toml"))
    shown.until(lambda: page.start.text() == "Ask 01 for consent")
    asked.clear()
    shown.click(page.start)
    assert asked[0].text == "You may stop." and "on the other screen" in shown.texts()
    page.to_close()()
    assert asked[-1] is None and page.to_close() is None
    shown.click(page.start)
    page.answer_consent(True)
    assert page.start.text() == "Start session   01 · 60 trials" and "agreed" in page.standing.text()
    shown.type(page.participant, "02")
    shown.click(page.start)
    page.participant_answers = False  # that screen is unplugged
    page.show_snapshot(page.snapshot)
    assert page.stack.currentWidget() is page.asking and page.cards.question is None and asked[-1] is None
