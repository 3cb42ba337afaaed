"""The page Analyse: points that can be read and opened, filters, timeouts above the scale, an export that is whole."""

import pickle
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import fake_client
import held_export
import numpy as np
import pytest
from own_files import MEASURE, measures_of
from page_driver import PageDriver
from protocols import short
from PySide6.QtCore import QEvent, QObject, QPointF, Qt
from PySide6.QtGui import QFontMetricsF
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QPushButton
from screens import settle
from sessions import closed_session

from app.ipc import messages as m
from app.window.analyse.analyse_page import AXES, TRIAL, AnalysePage
from app.window.analyse.box_plot import ChartPlot
from app.window.widgets import theme
from app.window.widgets.cards import EXCLUDE
from app.window.widgets.parts import KeyButton
from app.window.widgets.theme import COLOURS
from experiments.analysis.charts import ORDER, PERSON, POOLED, SPEED, charts
from experiments.analysis.own_measures import metrics_in
from experiments.analysis.trials_table import TrialRow, as_rows, as_table
from experiments.store.files import rows_of, session_folder
from experiments.store.session import Session
from tests.support.rows import put_session, read_rows, with_measures


def results_of(participant: str, seed: int) -> list[TrialRow]:
    """A participant's sixty trials, with scores that depend on the controller and a little on chance."""
    generator = np.random.default_rng(seed)
    return [
        with_measures(
            replace(
                fake_client.result(trial, error=1e-3 * trial.controller + 1e-4 * generator.random()),
                participant=participant,
            ),
            mean_tip_force_N=trial.controller + generator.random(),
            acceleration_dft_sum=30.0 * trial.controller + generator.random(),
        )
        for trial in fake_client.PLAN
    ]


def change(data: Path, participant: str, **what: TrialRow) -> None:
    """Rows of a table otherwise: run_3=the row."""
    rows = rows_of(session_folder(data, participant))
    changed = {row.run: row for row in what.values()}
    put_session(data, participant, [changed.get(row.run, row) for row in rows])


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for i, participant in enumerate(("01", "02", "03")):
        put_session(tmp_path, participant, results_of(participant, i))
    return tmp_path


def page_on(qtbot, data: Path | None = None) -> AnalysePage:
    """The page; of a data folder, once it has been read."""
    driver = PageDriver(qtbot, AnalysePage, (1280, 640))
    page = driver.page
    page.driver = driver  # lives as long
    if data is not None:
        page.begin(data)
        driver.until(lambda: page.results is not None)
    return page


def click(plot: ChartPlot, x: float, y: float) -> None:
    """A click on a place of the plot, in its own units."""
    QApplication.processEvents()
    place = plot.graph.mapFromScene(plot.item.vb.mapViewToScene(QPointF(x, y)))
    QTest.mouseClick(plot.graph.viewport(), Qt.MouseButton.LeftButton, pos=place)


def shown_in(page: AnalysePage) -> list[TrialRow]:
    return [] if page.trials is None else as_rows(page.trials)


def ringed(plot: ChartPlot) -> list[tuple[float, float]]:
    return [(mark.pos().x(), mark.pos().y()) for mark in plot.ring.points()]


def test_measures_of_ones_own_are_chosen_by_chips_and_go_into_the_export(qtbot, data: Path) -> None:
    page = page_on(qtbot, data)
    trials = as_table(with_measures(row, late_error_mm=-1.0 * row.run) for row in shown_in(page))
    own = metrics_in(measures_of("my_measure", MEASURE))
    page._show_results(page.results._replace(trials=trials, own=own))
    assert page.measures.chosen == {"path_error_m", "mean_tip_force_N", "acceleration_dft_sum", "late_error_mm"}
    QTest.mouseClick(page.measures.chips["acceleration_dft_sum"], Qt.MouseButton.LeftButton)
    shown = [plot for plot in page.plots if not plot.isHidden()]
    assert [plot.title.text() for plot in shown][2:] == ["Late error"]
    assert min(point.pos().y() for point in shown[2].points.points()) == -60.0 > shown[2].item.viewRange()[1][0] - 60.0
    sent = pickle.loads(pickle.dumps(page.view(page.results)))
    assert [metric.name for metric in sent.measures] == ["path_error_m", "mean_tip_force_N", "late_error_mm"]
    assert charts(POOLED, trials, sent)[2].lowest == -60.0


def test_without_a_folder_it_shows_that_of_the_open_session_and_follows_it(qtbot, data: Path) -> None:
    rows = rows_of(session_folder(data, "02"))
    put_session(data, "02", rows[:-1])
    page = page_on(qtbot)
    page.show_opened(fake_client.opened("02", folder=str(data / "sub-02" / "ses-01")))
    page.begin()
    qtbot.waitUntil(lambda: len(shown_in(page)) == 179, timeout=60_000)
    put_session(data, "02", rows)
    page.show_snapshot(fake_client.ready(60))
    qtbot.waitUntil(lambda: len(shown_in(page)) == 180, timeout=60_000)


def test_a_chip_takes_a_participant_a_device_or_a_status_away(qtbot, data: Path) -> None:
    row = rows_of(session_folder(data, "02"))[7]
    change(data, "02", row=replace(row, status="excluded"))
    page = page_on(qtbot, data)
    assert len(page.plots[0].points.points()) == 179 and page.statuses.chosen == {"done"}
    QTest.mouseClick(page.statuses.chips["excluded"], Qt.MouseButton.LeftButton)
    assert len(page.plots[0].points.points()) == 180 and sum(b.box.n for b in page.plots[0].chart.boxes) == 179
    QTest.mouseClick(page.people.chips["02"], Qt.MouseButton.LeftButton)
    assert len(page.plots[0].points.points()) == 120 and {row.participant for row in shown_in(page)} == {"01", "03"}
    QTest.mouseClick(page.devices.chips["four-brake"], Qt.MouseButton.LeftButton)
    assert len(page.plots[0].points.points()) == 60 and page.view(page.results).configurations == ("three-brake",)


def test_a_timeout_is_a_cross_above_the_scale_and_goes_into_the_boxes_only_if_asked(qtbot, data: Path) -> None:
    row = rows_of(session_folder(data, "01"))[3]
    change(data, "01", row=with_measures(replace(row, status="timeout"), path_error_m=0.065))
    page = page_on(qtbot, data)
    plot = page.plots[0]
    (cross,) = plot.crosses.points()
    assert plot.chart.highest < cross.pos().y() < plot.item.viewRange()[1][1] < 10.0
    assert cross.brush().color().name() == theme.shade(COLOURS.caution).name() and "1 timed out" in page.summary.text()
    assert "not in the boxes" in page.legend.text() and "65 mm · time was up" in plot._tip(0.0, 0.0, cross.data())
    plot.item.setYRange(1.0, 2.0, padding=0.0)
    assert 1.0 < plot.crosses.points()[0].pos().y() < 2.0  # it stays above whatever part of the scale is seen
    QTest.mouseClick(page.timeouts, Qt.MouseButton.LeftButton)
    assert not len(plot.crosses.points()) and plot.item.viewRange()[1][1] > 65.0


def test_a_data_folder_of_180_trials_shows_them_all_on_a_logarithmic_axis_as_well(qtbot, data: Path) -> None:
    page = page_on(qtbot, data)
    assert [len(plot.points.points()) for plot in page.plots if not plot.isHidden()] == [180, 180, 180]
    assert "3 participants · 180 trials" in page.summary.text() and page.measures.isHidden()
    QTest.mouseClick(page.logarithmic, Qt.MouseButton.LeftButton)
    values = sorted(point.pos().y() for point in page.plots[0].points.points())
    wanted = sorted(np.log10(1e3 * row.value("path_error_m")) for row in shown_in(page))
    assert values == pytest.approx(wanted) and len(page.plots[0].chart.boxes) == 10


def test_the_title_of_an_axis_stands_in_its_middle_and_the_scale_stays_when_it_has_been_painted(qtbot, data: Path):
    page = page_on(qtbot, data)
    axis, box = page.plots[0].item.getAxis("bottom"), page.plots[0].item.vb
    for name in (ORDER, SPEED, ORDER):
        page.show_page(name)
        settle(page)
        before = box.sceneBoundingRect()
        page.grab()
        settle(page)
        assert box.sceneBoundingRect() == before
        middle = axis.label.mapRectToScene(axis.label.boundingRect()).center().x()
        assert middle == pytest.approx(before.center().x(), abs=2.0), name


def test_codes_of_a_blind_session_have_one_colour_and_nothing_is_claimed(qtbot, data: Path) -> None:
    for who in ("01", "02", "03"):
        rows = [replace(row, controller=f"K{row.controller}") for row in rows_of(session_folder(data, who))]
        put_session(data, who, rows)
    page = page_on(qtbot, data)
    quiet = theme.shade(COLOURS.quiet).name()
    assert {point.pen().color().name() for point in page.plots[0].points.points()} == {quiet}
    assert page.plots[0].colour_of("K3") == COLOURS.quiet and "●" not in page.legend.text()


@pytest.fixture(scope="module")
def two_trials(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data folder of a session of two trials."""
    data = tmp_path_factory.mktemp("two") / "data"
    closed_session(data, 2, protocol=short())
    return data


def test_a_legend_names_each_controller_in_the_colour_of_its_points(qtbot, two_trials: Path) -> None:
    page = page_on(qtbot, two_trials)
    for name in (POOLED, PERSON, ORDER, SPEED):
        page.show_page(name)
        drawn = {point.data().controller: point.pen().color().name() for point in page.plots[0].points.points()}
        shown = page.legend.text().replace("\u00a0", " ")
        assert page.legend.isVisible() and len(drawn) == shown.count("●") > 0
        for controller, colour in drawn.items():
            assert f'color: {colour}">●</span> {page.view(page.results).name(controller)}'.lower() in shown.lower()


def test_many_participants_are_chosen_below_one_button_that_stays_open_and_counts_them(qtbot, tmp_path: Path) -> None:
    for n in range(1, 25):
        who = f"{n:02d}"
        put_session(tmp_path, who, results_of(who, n)[:4])
    page = page_on(qtbot, tmp_path)
    people = page.people
    assert people.menu.text().startswith("Participants: all of 24")
    menu = people.menu.menu()
    menu.popup(page.mapToGlobal(page.rect().center()))
    for who in ("07", "08"):
        QTest.mouseClick(people.chips[who], Qt.MouseButton.LeftButton)
    assert menu.isVisible() and people.menu.text().startswith("Participants: 22 of 24") and len(shown_in(page)) == 88
    QApplication.processEvents()
    for chip in people.chips.values():
        assert chip.width() >= chip.sizeHint().width() and menu.rect().contains(chip.mapTo(menu, chip.rect().center()))
    every, none = menu.findChildren(QPushButton, "small")
    QTest.mouseClick(none, Qt.MouseButton.LeftButton)
    assert not shown_in(page) and "none" in page.empty.text().lower()
    QTest.mouseClick(people.chips["12"], Qt.MouseButton.LeftButton)
    assert {row.participant for row in shown_in(page)} == {"12"}
    QTest.mouseClick(every, Qt.MouseButton.LeftButton)
    assert len(shown_in(page)) == 96
    menu.close()
    page.show_page(PERSON)
    QApplication.processEvents()
    axis, font = page.plots[0].item.getAxis("bottom"), theme.font(theme.SMALL)
    named = [(axis.mapFromParent(page.plots[0].item.vb.mapViewToScene(QPointF(x, 0.0))).x(), text)
             for x, text in axis._tickLevels[0]]  # fmt: skip
    assert len(named) > 5  # every second or third name, and none lies on another
    for (x, text), (beyond, other) in pairwise(named):
        assert beyond - x > 0.5 * sum(QFontMetricsF(font).horizontalAdvance(word) for word in (text, other))


def test_a_trial_has_the_page_to_itself_and_gives_it_back(qtbot, two_trials: Path) -> None:
    page = page_on(qtbot, two_trials)
    page.show_page(TRIAL)
    qtbot.waitUntil(lambda: page.side.trial is not None, timeout=60_000)
    assert page.side.isVisible() and not page.charts.isVisible() and not page.axis.isVisible()
    page.to_close()()
    assert page.charts.isVisible() and page.tabs.value() == POOLED and page.axis.isVisible()


def test_error_against_force_shows_the_medians_of_the_chosen_trials_and_points_have_the_shape_of_their_path(
    qtbot, data: Path
) -> None:
    page = page_on(qtbot, data)
    QTest.mouseClick(page.people.chips["02"], Qt.MouseButton.LeftButton)
    cells = page.trials.groupby(["controller", "configuration"])
    medians = {
        (round(force, 9), round(np.log2(1e3 * error), 9))
        for force, error in cells[["mean_tip_force_N", "path_error_m"]].median().itertuples(index=False)
    }
    assert {(round(p.pos().x(), 9), round(p.pos().y(), 9)) for p in page.force.circles.points()} == medians
    assert page.force.isVisible()
    shapes = {point.data().row.segment: point.symbol() for point in page.plots[0].points.points()}
    assert shapes == {1: "o", 2: "t1"} and "Triangle: path 2." in page.legend.text()
    page.show_page(PERSON)
    assert not page.force.isVisible()


def test_an_axis_is_offered_for_what_there_is_and_stays_chosen(qtbot, data: Path) -> None:
    page = page_on(qtbot, data)
    assert page.axis.count() == len(AXES), "nobody was asked a questionnaire"
    page.show_page(ORDER)
    page.show_page(PERSON)
    page.show_page(POOLED)
    assert page.page == ORDER and set(page.statuses.chips) == {"done"}, "states that occur"


def test_a_page_without_anything_says_so(qtbot, data: Path, tmp_path: Path) -> None:
    page = page_on(qtbot, data)
    page.begin(tmp_path / "none")
    qtbot.waitUntil(lambda: "no such folder" in page.empty.text(), timeout=60_000)
    (tmp_path / "new").mkdir()
    page.begin(tmp_path / "new")
    qtbot.waitUntil(lambda: "Nothing is recorded" in page.empty.text(), timeout=60_000)
    assert not page.export_button.isEnabled() and not page.tabs.isEnabled()


def test_a_click_on_a_point_opens_its_trial_and_rings_it_in_all_plots(qtbot, data: Path) -> None:
    page = page_on(qtbot, data)
    rows = shown_in(page)
    row = replace(rows[100], recording="")
    page.results = page.results._replace(trials=as_table(row if n == 100 else r for n, r in enumerate(rows)))
    page._show()
    point = next(p for p in page.plots[1].chart.points if p.row == row)
    click(page.plots[1], point.x, point.y)
    assert page.chosen == row and page.side.isVisible() and page.side.title.text() == f"Participant 02, trial {row.run}"
    assert "no recording" in page.side.note.text()
    for plot in page.plots[:3]:
        (x, y), wanted = ringed(plot)[0], next(p for p in plot.chart.points if p.row == row)
        assert (x, y) == pytest.approx((wanted.x, wanted.y))
    page.show_page(PERSON)
    assert len(ringed(page.plots[2])) == 1
    page.show_page(POOLED)
    assert page.own_keys()["Left"] == "0.1 s back"
    page.to_close()()
    assert not page.side.isVisible() and page.to_close() is None and not ringed(page.plots[0])
    assert page.own_keys() == {}, "the player is not there"


def test_of_points_that_lie_over_each_other_the_nearest_one_is_opened(qtbot, data: Path) -> None:
    page, opened = page_on(qtbot, data), []
    plot = page.plots[0]
    plot.chosen.connect(opened.append)
    first, last = (point for point in plot.chart.points if point.row in (shown_in(page)[0], shown_in(page)[-1]))
    x, y = first.x, first.y
    pixel = plot.item.vb.viewPixelSize()[0]
    beside = [first, last._replace(x=x + 2.5 * pixel, y=y)]  # drawn over it
    plot.show_chart(plot.chart._replace(points=tuple(beside)), False)
    click(plot, x + 0.5 * pixel, y)
    assert opened == [first.row]


def test_what_is_under_the_pointer_is_named_by_participant_controller_run_and_value(qtbot, data: Path) -> None:
    page = page_on(qtbot, data)
    row = shown_in(page)[60]
    point = next(p for p in page.plots[0].points.points() if p.data().row == row)
    tip = page.plots[0]._tip(0.0, 0.0, point.data())
    error_mm = 1e3 * row.value("path_error_m")
    assert tip == f"Participant 02 · controller {row.controller} · trial {row.run} · {error_mm:.3g} mm"
    page.logarithmic.click()  # a box says its numbers, on any scale
    placed = page.plots[0].chart.boxes[2]
    device = page.results.configurations[placed.look]
    errors = sorted(
        1e3 * r.value("path_error_m")
        for r in shown_in(page)
        if r.controller == placed.controller and r.configuration == device
    )
    said = page.plots[0].read_at(QPointF(placed.x, np.log10(placed.box.median)))
    assert said.startswith(f"Box of 18: median {np.median(errors):.3g} mm, quartiles ") and len(errors) == 18
    assert page.plots[0].read_at(QPointF(placed.x, np.log10(1.01 * placed.box.q3))) == ""


@pytest.fixture
def recorded(qtbot, tmp_path: Path, two_trials: Path) -> AnalysePage:
    """The page on a session of two trials that is not open, with the second beside the charts."""
    data = shutil.copytree(two_trials, tmp_path / "data")
    page = page_on(qtbot, data / "sub-01" / "ses-01" / "trials" / "run-002.parquet")
    qtbot.waitUntil(lambda: page.side.trial is not None and bool(shown_in(page)), timeout=60_000)
    return page


def test_a_recording_that_is_asked_for_opens_among_the_trials_of_its_data_folder(qtbot, tmp_path, recorded) -> None:
    page = recorded
    assert page.results.folder == (tmp_path / "data").resolve() and page.side.title.text() == "Participant 01, trial 2"
    qtbot.waitUntil(lambda: len(page.plots[0].points.points()) == 2, timeout=60_000)
    assert all(len(ringed(plot)) == 1 for plot in page.plots[:3]) and not page.side.playing
    page.keys()["start"]()
    assert page.side.playing
    page.end()
    assert not page.side.playing  # another page is at the front


def exclude(page: AnalysePage, reason: int) -> None:
    """Press the button, and of what it asks the reason in this place."""
    page.side.exclude.click()
    page.cards.question.findChildren(KeyButton)[reason].click()


def test_a_trial_of_a_session_that_is_not_open_is_excluded_for_a_reason_and_then_says_so(qtbot, recorded) -> None:
    page, reason = recorded, EXCLUDE.reasons[1]
    assert page.side.exclude.isVisible()
    exclude(page, 1)
    qtbot.waitUntil(lambda: reason in page.side.note.text(), timeout=60_000)
    assert page.side.note.text() == f"This trial is excluded: {reason}." and not page.side.exclude.isVisible()
    assert "excluded" in page.side.about.text() and [row.run for row in shown_in(page)] == [1]
    session = page.results.folder / "sub-01" / "ses-01"
    assert [row.status for row in read_rows(session / "trials.csv")] == ["done", "excluded"]
    resumed = Session.resume(page.results.folder, "01")
    assert [row.status for row in resumed.rows] == ["done", "excluded"]
    resumed.close()


def test_a_trial_of_the_open_session_is_excluded_by_the_session_server(qtbot, recorded: AnalysePage) -> None:
    page, sent = recorded, []
    page.send = sent.append
    session = page.results.folder / "sub-01" / "ses-01"
    page.show_opened(fake_client.opened("01", folder=str(session)))
    exclude(page, 0)
    assert sent == [m.Exclude(2, EXCLUDE.reasons[0])]
    page.show_snapshot(fake_client.ready(2, notice="A trial is running.", notice_bad=True))
    assert page.side.note.text() == "A trial is running."


def test_a_session_that_another_process_has_open_is_not_touched(qtbot, recorded: AnalysePage) -> None:
    page = recorded
    other = Session.resume(page.results.folder, "01")
    try:
        exclude(page, 0)
        qtbot.waitUntil(lambda: "is using this folder" in page.side.note.text(), timeout=60_000)
    finally:
        other.close()
    assert [row.status for row in read_rows(other.folder / "trials.csv")] == ["done", "done"]


def test_the_report_of_one_session_is_asked_for_beside_the_sessions_and_not_in_it(qtbot, two_trials, monkeypatch):
    session = two_trials / "sub-01" / "ses-01"
    page = page_on(qtbot, session)
    begun: list[bytes] = []
    monkeypatch.setattr(page.export_task, "begin", lambda module, given: begun.append(given))
    QTest.mouseClick(page.report_button, Qt.MouseButton.LeftButton)
    job = pickle.loads(begun[0])
    assert (job.folder, job.report, job.sessions) == (two_trials / "results-1", True, (session,))


def test_the_next_trial_and_the_one_before_are_those_that_are_shown(qtbot, data: Path) -> None:
    page = page_on(qtbot, data)
    QTest.mouseClick(page.people.chips["02"], Qt.MouseButton.LeftButton)
    last = max((row for row in shown_in(page) if row.participant == "01"), key=lambda row: row.run)
    page.open_trial(last)
    page.step(1)
    assert (page.chosen.participant, page.chosen.run) == ("03", 1)
    page.step(-1)
    assert page.chosen == last


def test_an_export_is_whole_and_in_a_new_folder(qtbot, data: Path) -> None:
    (data / "results-1").mkdir()
    page = page_on(qtbot, data)
    page.show_message("10 files written", "good")  # of an export before
    QTest.mouseClick(page.people.chips["02"], Qt.MouseButton.LeftButton)
    page.keys()["export"]()
    assert page.cancel_button.isVisible() and not page.export_button.isEnabled()
    settle(page)
    assert page.message.text().startswith("Writing") and page.message.objectName() == "quiet"
    assert page.cancel_button.width() == page.cancel_button.sizeHint().width() and page.bar.width() == 160
    qtbot.waitUntil(lambda: page.message.text().endswith("results-2"), timeout=120_000)
    folder = data / "results-2"
    assert {path.suffix for path in folder.iterdir()} == {".png", ".svg", ".pdf", ".csv"}
    exported = read_rows(folder / "trials.csv")
    assert len(exported) == 120 and page.folder_button.isVisible() and page.message.objectName() == "good"
    assert (folder / exported[0].recording).resolve() == data / "sub-01" / "ses-01" / "trials" / "run-001.parquet"


@pytest.mark.parametrize("end", ["cancelled", "killed"])
def test_an_export_that_does_not_end_leaves_nothing(qtbot, data: Path, monkeypatch, end: str) -> None:
    page = page_on(qtbot, data)
    before = sorted(data.iterdir())
    begin = page.export_task.begin
    monkeypatch.setattr(page.export_task, "begin", lambda module, given: begin(module="held_export", given=given))
    monkeypatch.setenv("PYTHONPATH", str(Path(held_export.__file__).parent))
    page.export()
    partial = data / ".results-1.partial"
    qtbot.waitUntil(partial.exists, timeout=120_000)
    if end == "killed":
        page.export_task._process.kill()
    else:
        QTest.mouseClick(page.cancel_button, Qt.MouseButton.LeftButton)
        assert page.export_task._process.poll() is not None
    said = "Nothing was written" if end == "killed" else "cancelled"
    qtbot.waitUntil(lambda: said in page.message.text(), timeout=60_000)
    assert sorted(data.iterdir()) == before and not page.cancel_button.isVisibleTo(page)


class Painted(QObject):
    """Counts what is painted."""

    count = 0

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        self.count += event.type() == QEvent.Type.Paint
        return False


def test_an_idle_page_paints_nothing(qtbot, data: Path) -> None:
    page, painted = page_on(qtbot, data), Painted()
    for widget in (page, *(plot.graph.viewport() for plot in page.plots)):
        widget.installEventFilter(painted)
    page.plots[0].graph.viewport().update()
    qtbot.waitUntil(lambda: painted.count > 0, timeout=60_000)

    def nothing_is_painted() -> bool:
        painted.count = 0
        QTest.qWait(500)
        return painted.count == 0

    qtbot.waitUntil(nothing_is_painted, timeout=60_000)  # what the page still had to do is done
    assert nothing_is_painted()
