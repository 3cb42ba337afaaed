"""The page Analyse: points that can be read and opened, filters, timeouts above the scale, an export that is whole."""

import pickle
import shutil
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import fake_client
import held_export
import numpy as np
import pytest
from own_files import MEASURE, measures_of
from page_driver import LEFT, PageDriver, texts
from protocols import short
from PySide6.QtCore import QEvent, QObject, QPointF
from PySide6.QtGui import QFontMetricsF
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QApplication, QPushButton
from screens import settle
from sessions import closed_session

from app.ipc import messages as m
from app.window.analyse.analyse_page import AXES, TRIAL, AnalysePage
from app.window.analyse.box_plot import ChartPlot
from app.window.widgets import palette, theme
from app.window.widgets.cards import EXCLUDE
from app.window.widgets.parts import KeyButton
from app.window.widgets.theme import COLOURS
from experiments.analysis.charts import ORDER, PERSON, POOLED, SPEED, charts
from experiments.analysis.own_measures import metrics_in
from experiments.analysis.trials_table import TrialRow, as_rows, as_table
from experiments.atomic_files import partial_name
from experiments.export.results import Results, read_results
from experiments.store.files import rows_of, session_folder
from experiments.store.session import Session
from tests.support.rows import put_session, read_rows, with_measures

#: of the plan, the first trial of each controller, device and path: runs 1 to 10 and 31 to 40
PLANNED = [*fake_client.PLAN[:10], *fake_client.PLAN[30:40]]


def results_of(participant: str, seed: int) -> list[TrialRow]:
    """A participant's twenty trials, with scores that depend on the controller and a little on chance."""
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
        for trial in PLANNED
    ]


def put_three(folder: Path) -> Path:
    """The sessions of three participants."""
    for seed, participant in enumerate(("01", "02", "03")):
        put_session(folder, participant, results_of(participant, seed))
    return folder


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """The results of three participants, which no test changes in their folder."""
    results = read_results(put_three(tmp_path_factory.mktemp("three")))
    return results._replace(controllers=fake_client.PRESETS, lengths={1: 0.2, 2: 0.17})


def new_page(qtbot) -> AnalysePage:
    driver = PageDriver(qtbot, AnalysePage, (1280, 640))
    driver.page.driver = driver  # lives as long
    return driver.page


@pytest.fixture
def page(qtbot, three: Results) -> AnalysePage:
    """The page with these results."""
    page = new_page(qtbot)
    page._folder = three.folder
    page._show_results(three)
    return page


def page_on(qtbot, folder: Path) -> AnalysePage:
    """The page of a data folder, once it has been read."""
    page = new_page(qtbot)
    page.begin(folder)
    page.driver.until(lambda: page.results is not None)
    return page


def show_rows(page: AnalysePage, rows: Iterable[TrialRow]) -> None:
    page._show_results(page.results._replace(trials=as_table(rows)))


def click_on(widget: QAbstractButton) -> None:
    QTest.mouseClick(widget, LEFT)


def click(plot: ChartPlot, x: float, y: float) -> None:
    """A click on a place of the plot, in its own units."""
    QApplication.processEvents()
    place = plot.graph.mapFromScene(plot.item.vb.mapViewToScene(QPointF(x, y)))
    QTest.mouseClick(plot.graph.viewport(), LEFT, pos=place)


def shown_in(page: AnalysePage) -> list[TrialRow]:
    return [] if page.trials is None else as_rows(page.trials)


def ringed(plot: ChartPlot) -> list[tuple[float, float]]:
    return [(mark.pos().x(), mark.pos().y()) for mark in plot.ring.points()]


class State(NamedTuple):
    """What is recorded and clicked, and what the page then shows."""

    of: Callable[[TrialRow], TrialRow] = lambda row: row  # each of the sixty rows
    clicks: Callable[[AnalysePage], tuple[QAbstractButton, ...]] = lambda page: ()
    points: int = 60
    crosses: int = 0
    in_boxes: int = 60
    reads: tuple[str, ...] = ()
    never: tuple[str, ...] = ()


def of_02(number: int, status: str, **measures: float) -> Callable[[TrialRow], TrialRow]:
    """One trial of a participant otherwise."""

    def of(row: TrialRow) -> TrialRow:
        hit = (row.participant, row.run) == ("02", number)
        return with_measures(replace(row, status=status), **measures) if hit else row

    return of


LATE = of_02(4, "timeout", path_error_m=0.065)
STATES = {
    "all": State(reads=("3 sessions · 60 trials shown", "△ path 2.", "●"), never=("timed out", "not shown", "Trials")),
    "one is excluded": State(of_02(8, "excluded"), points=59, in_boxes=59,
                             reads=("59 trials shown · not shown: 1 excluded",), never=("by the experimenter",)),
    "and looked at": State(of_02(8, "excluded"), lambda page: (page.statuses.chips["excluded"],), in_boxes=59),
    "without a participant": State(clicks=lambda page: (page.people.chips["02"],), points=40, in_boxes=0,
                                   reads=("40 trials shown · not shown: 20 done", "Boxes need at least 5 trials")),
    "without a device": State(clicks=lambda page: (page.devices.chips["four-brake"],), points=30, in_boxes=30),
    "without anything": State(clicks=lambda page: tuple(page.people.chips.values()),
                              reads=("None of the trials is chosen",)),
    "one timed out": State(LATE, points=59, crosses=1, in_boxes=59, reads=("1 trial timed out", "not in the boxes")),
    "and is in the boxes": State(LATE, lambda page: (page.timeouts,), never=("not in the boxes",)),
    "linear": State(clicks=lambda page: (page.logarithmic,), never=("log scale,",)),
}  # fmt: skip


@pytest.mark.parametrize("name", STATES)
def test_what_is_recorded_and_chosen_is_shown_and_nothing_else(page: AnalysePage, name: str) -> None:
    state = STATES[name]
    show_rows(page, map(state.of, shown_in(page)))
    for button in state.clicks(page):
        click_on(button)
    seen, plots = texts(page), [plot for plot in page.plots if plot.isVisible()]
    assert all(text in seen for text in state.reads) and not any(text in seen for text in state.never), seen
    assert not page.measures.isVisible() and page.timeouts.isVisible() == (state.of is LATE)
    for plot in plots:
        assert (len(plot.points.points()), len(plot.crosses.points())) == (state.points, state.crosses)
        assert sum(placed.box.n for placed in plot.chart.boxes) == state.in_boxes
    drawn = {point.data().row.run: point for point in page.plots[0].points.points()}
    if name in ("all", "linear"):
        rows = {row.run: 1e3 * row.value("path_error_m") for row in shown_in(page) if row.participant == "03"}
        placed = {run: np.log10(mm) if name == "all" else mm for run, mm in rows.items()}
        assert {run: point.pos().y() for run, point in drawn.items()} == pytest.approx(placed)
        for plot in plots:
            (low, high), named = plot.item.viewRange()[1], plot.item.getAxis("left")._tickLevels[0]
            assert len(named) >= 3 and all(low <= at <= high for at, _ in named), "as many values as can be read"
            assert all(float(text) == pytest.approx(10.0**at if plot.chart.logarithmic else at) for at, text in named)
    if name == "one timed out":
        (cross,), plot = page.plots[0].crosses.points(), page.plots[0]
        assert np.log10(plot.chart.highest) < cross.pos().y() < plot.item.viewRange()[1][1] < 1.0
        assert "65 mm · time was up" in plot._tip(0.0, 0.0, cross.data())
        plot.item.setYRange(1.0, 2.0, padding=0.0)
        assert 1.0 < plot.crosses.points()[0].pos().y() < 2.0, "it stays above whatever part of the scale is seen"


def test_codes_of_a_blind_session_have_one_colour_and_nothing_is_claimed(qtbot, tmp_path: Path) -> None:
    put_session(tmp_path, "01", [replace(row, controller=f"K{row.controller}") for row in results_of("01", 1)])
    page = page_on(qtbot, tmp_path)
    colours = {point.pen().color().name() for point in page.plots[0].points.points()}
    assert colours == {theme.shade(COLOURS.quiet).name()} and "●" not in page.legend.text()


def test_measures_of_ones_own_are_chosen_by_chips_and_go_into_the_export(page: AnalysePage) -> None:
    trials = as_table(with_measures(row, late_error_mm=-1.0 * row.run) for row in shown_in(page))
    own = metrics_in(measures_of("my_measure", MEASURE))
    page._show_results(page.results._replace(trials=trials, own=own))
    assert page.measures.chosen == {"path_error_m", "mean_tip_force_N", "acceleration_dft_sum", "late_error_mm"}
    click_on(page.measures.chips["acceleration_dft_sum"])
    shown = [plot for plot in page.plots if not plot.isHidden()]
    assert [plot.title.text() for plot in shown][2:] == ["Late error"]
    lowest = min(point.pos().y() for point in shown[2].points.points())
    assert lowest == -40.0 > shown[2].item.viewRange()[1][0] - 40.0
    sent = pickle.loads(pickle.dumps(page.view(page.results)))
    assert [metric.name for metric in sent.measures] == ["path_error_m", "mean_tip_force_N", "late_error_mm"]
    assert charts(POOLED, trials, sent)[2].lowest == -40.0


def test_without_a_folder_it_shows_that_of_the_open_session_and_follows_it(qtbot, tmp_path: Path) -> None:
    put_three(tmp_path)
    rows = rows_of(session_folder(tmp_path, "02"))
    put_session(tmp_path, "02", rows[:-1])
    page = new_page(qtbot)
    page.show_opened(fake_client.opened("02", folder=str(tmp_path / "sub-02" / "ses-01")))
    page.begin()
    qtbot.waitUntil(lambda: len(shown_in(page)) == 59, timeout=60_000)
    put_session(tmp_path, "02", rows)
    page.show_snapshot(fake_client.ready(60))
    qtbot.waitUntil(lambda: len(shown_in(page)) == 60, timeout=60_000)


def test_axes_have_their_titles_in_the_middle_colours_their_names_and_another_theme_acts_at_once(page) -> None:
    axis, box = page.plots[0].item.getAxis("bottom"), page.plots[0].item.vb
    assert page.axis.count() == len(AXES), "nobody was asked a questionnaire"
    for name in (POOLED, PERSON, ORDER, SPEED):
        page.show_page(name)
        settle(page)
        before = box.sceneBoundingRect()
        page.grab()
        assert box.sceneBoundingRect() == before, "the scale stays when it has been painted"
        if name in (ORDER, SPEED):
            middle = axis.label.mapRectToScene(axis.label.boundingRect()).center().x()
            assert middle == pytest.approx(before.center().x(), abs=2.0), name
        assert page.force.isVisible() == (name == POOLED)
        assert_named(page)
    page.show_page(PERSON)
    page.show_page(POOLED)
    assert page.page == SPEED, "an axis stays as it was chosen"
    palette.choose("light")
    theme.colour_all()
    assert_named(page)
    palette.choose("dark")
    theme.colour_all()


def assert_named(page: AnalysePage) -> None:
    """The legend has each controller in the colour of its points, that of the theme."""
    points = {point.data().controller: point for point in page.plots[0].points.points()}
    shown, view = page.legend.text().replace("\u00a0", " "), page.view(page.results)
    assert page.legend.isVisible() and len(points) == shown.count("●") == 5
    for controller, point in points.items():
        colour = point.pen().color()
        assert colour == theme.shade(theme.colour_at(view.colours[controller]))
        assert f'color: {colour.name()}">●</span> {view.name(controller)}' in shown


def test_many_participants_are_chosen_below_one_button_that_stays_open_and_counts_them(page: AnalysePage) -> None:
    rows = results_of("01", 0)[:4]
    show_rows(page, [replace(row, participant=f"{n:02d}") for n in range(1, 25) for row in rows])
    people = page.people
    assert people.menu.text().startswith("Participants: all of 24")
    menu = people.menu.menu()
    menu.popup(page.mapToGlobal(page.rect().center()))
    for who in ("07", "08"):
        click_on(people.chips[who])
    assert menu.isVisible() and people.menu.text().startswith("Participants: 22 of 24") and len(shown_in(page)) == 88
    QApplication.processEvents()
    for chip in people.chips.values():
        assert chip.width() >= chip.sizeHint().width() and menu.rect().contains(chip.mapTo(menu, chip.rect().center()))
    every, none = menu.findChildren(QPushButton, "small")
    click_on(none)
    assert not shown_in(page)
    click_on(people.chips["12"])
    assert {row.participant for row in shown_in(page)} == {"12"}
    click_on(every)
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


def test_error_against_force_shows_the_medians_of_the_chosen_trials_and_points_have_the_shape_of_their_path(page):
    click_on(page.people.chips["02"])
    cells = page.trials.groupby(["controller", "configuration"])
    medians = {
        (round(force, 9), round(np.log2(1e3 * error), 9))
        for force, error in cells[["mean_tip_force_N", "path_error_m"]].median().itertuples(index=False)
    }
    assert {(round(p.pos().x(), 9), round(p.pos().y(), 9)) for p in page.force.circles.points()} == medians
    shapes = {point.data().row.path: point.symbol() for point in page.plots[0].points.points()}
    assert shapes == {1: "o", 2: "t1"}


def test_a_page_without_anything_says_so(qtbot, page: AnalysePage, tmp_path: Path) -> None:
    page.begin(tmp_path / "none")
    qtbot.waitUntil(lambda: "no such folder" in page.empty.text(), timeout=60_000)
    page.begin(tmp_path)
    qtbot.waitUntil(lambda: "Nothing is recorded" in page.empty.text(), timeout=60_000)
    assert not page.export_button.isEnabled() and not page.tabs.isEnabled()
    for person in ("01", "02"):
        lost = tmp_path / f"sub-{person}" / "ses-01" / "trials" / "run-001.parquet"
        lost.parent.mkdir(parents=True)
        lost.touch()
    page.begin(tmp_path)
    qtbot.waitUntil(lambda: f"No trial in {tmp_path} can be read." in page.empty.text(), timeout=60_000)
    assert [line[:6] for line in page.empty.text().split("\n")[2:]] == ["sub-01", "sub-02"], "a line each"


def test_a_click_on_a_point_opens_its_trial_and_rings_it_in_all_plots_and_steps_go_on_from_it(page) -> None:
    row = shown_in(page)[27]
    show_rows(page, [replace(each, recording="") if each == row else each for each in shown_in(page)])
    row = replace(row, recording="")
    point = next(p for p in page.plots[1].chart.points if p.row == row)
    click(page.plots[1], point.x, point.y)
    assert page.chosen == row and page.side.isVisible() and page.side.title.text() == f"Participant 02, trial {row.run}"
    assert "no recording" in page.side.note.text()
    assert page.own_keys()["Left"] == "0.1 s back" and not page.charts.isVisible()
    page.to_close()()
    for plot in page.plots[:3]:
        (x, y), wanted = ringed(plot)[0], next(p for p in plot.chart.points if p.row == row)
        assert (x, y) == pytest.approx((wanted.x, np.log10(wanted.y) if plot.chart.logarithmic else wanted.y))
    page.show_page(PERSON)
    assert len(ringed(page.plots[2])) == 1
    page.show_page(TRIAL)
    assert page.side.title.text() == f"Participant 02, trial {row.run}", "the one that was looked at last"
    page.to_close()()
    assert page.tabs.value() == PERSON and not page.side.isVisible() and page.to_close() is None
    assert ringed(page.plots[0]) and page.own_keys() == {}, "the player is not there"
    click_on(page.people.chips["02"])
    last = max((row for row in shown_in(page) if row.participant == "01"), key=lambda row: row.run)
    page.open_trial(last)
    page.step(1)
    assert (page.chosen.participant, page.chosen.run) == ("03", 1)
    page.step(-1)
    assert page.chosen == last


def test_of_points_that_lie_over_each_other_the_nearest_one_is_opened(page: AnalysePage) -> None:
    opened, plot = [], page.plots[0]
    plot.chosen.connect(opened.append)
    first, last = plot.chart.points[0], plot.chart.points[-1]
    pixel = plot.item.vb.viewPixelSize()[0]
    beside = first, last._replace(x=first.x + 2.5 * pixel, y=first.y)  # drawn over it
    plot.show_chart(plot.chart._replace(points=beside, logarithmic=False))
    click(plot, first.x + 0.5 * pixel, first.y)
    assert opened == [first.row]


def test_what_is_under_the_pointer_is_named_by_participant_controller_trial_and_value(page: AnalysePage) -> None:
    point = next(p for p in page.plots[0].points.points() if p.data().row.participant == "02")
    row, tip = point.data().row, page.plots[0]._tip(0.0, 0.0, point.data())
    error_mm = 1e3 * row.value("path_error_m")
    assert tip == f"Participant 02 · controller {row.controller} · trial {row.run} · {error_mm:.3g} mm"
    placed = page.plots[0].chart.boxes[2]
    device = page.results.configurations[placed.look]
    errors = [
        1e3 * r.value("path_error_m")
        for r in shown_in(page)
        if r.controller == placed.controller and r.configuration == device
    ]
    said = page.plots[0].read_at(QPointF(placed.x, np.log10(placed.box.median)))
    assert said.startswith(f"Box of 6: median {np.median(errors):.3g} mm, quartiles ") and len(errors) == 6
    assert page.plots[0].read_at(QPointF(placed.x, np.log10(1.01 * placed.box.q3))) == ""


# a session of two trials, which are recorded


@pytest.fixture(scope="module")
def two_trials(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data folder of a session of two trials."""
    data = tmp_path_factory.mktemp("two") / "data"
    closed_session(data, 2, protocol=short())
    return data


@pytest.fixture
def recorded(qtbot, tmp_path: Path, two_trials: Path) -> AnalysePage:
    """The page on a session of two trials that is not open, with the second in front."""
    data = shutil.copytree(two_trials, tmp_path / "data")
    page = page_on(qtbot, data / "sub-01" / "ses-01" / "trials" / "run-002.parquet")
    qtbot.waitUntil(lambda: page.side.trial is not None and bool(shown_in(page)), timeout=60_000)
    return page


def test_a_recording_opens_alone_among_the_trials_of_its_data_folder(recorded, tmp_path):
    page = recorded
    assert page.results.folder == (tmp_path / "data").resolve() and page.side.title.text() == "Participant 01, trial 2"
    page.driver.until(lambda: len(page.plots[0].points.points()) == 2)
    assert not page.side.playing
    page.keys()["start"]()
    assert page.side.playing
    page.end()
    assert not page.side.playing  # another page is at the front
    assert page.side.isVisible() and not page.charts.isVisible() and not page.axis.isVisible()
    page.driver.until(page.side.workspace.isVisible)
    page.to_close()()
    assert page.charts.isVisible() and page.tabs.value() == POOLED and page.axis.isVisible()
    assert all(len(ringed(plot)) == 1 for plot in page.plots[:3])


def exclude(page: AnalysePage, reason: int) -> None:
    """Press the button, and of what it asks the reason in this place."""
    page.side.exclude.click()
    page.cards.question.findChildren(KeyButton)[reason].click()


def test_a_trial_of_a_session_that_is_not_open_is_excluded_unless_another_process_has_it(qtbot, recorded) -> None:
    page, reason = recorded, EXCLUDE.reasons[1]
    table = page.results.folder / "sub-01" / "ses-01" / "trials.csv"
    other = Session.resume(page.results.folder, "01")
    try:
        exclude(page, 0)
        qtbot.waitUntil(lambda: "is using this folder" in page.side.note.text(), timeout=60_000)
    finally:
        other.close()
    assert [row.status for row in read_rows(table)] == ["done", "done"] and page.side.exclude.isVisible()
    exclude(page, 1)
    qtbot.waitUntil(lambda: reason in page.side.note.text(), timeout=60_000)
    assert page.side.note.text() == f"This trial is excluded: {reason}." and not page.side.exclude.isVisible()
    assert "excluded" in page.side.about.text() and [row.run for row in shown_in(page)] == [1]
    assert [row.status for row in read_rows(table)] == ["done", "excluded"]
    resumed = Session.resume(page.results.folder, "01")
    assert [row.status for row in resumed.rows] == ["done", "excluded"]
    resumed.close()


def test_a_trial_of_the_open_session_is_excluded_by_the_session_server(recorded: AnalysePage) -> None:
    page, sent = recorded, []
    page.send = sent.append
    session = page.results.folder / "sub-01" / "ses-01"
    page.show_opened(fake_client.opened("01", folder=str(session)))
    exclude(page, 0)
    assert sent == [m.Exclude(2, EXCLUDE.reasons[0])]
    page.show_snapshot(fake_client.ready(2, notice="A trial is running.", notice_bad=True))
    assert page.side.note.text() == "A trial is running."


# export


def test_the_report_of_one_session_is_asked_for_beside_the_sessions_and_not_in_it(qtbot, two_trials, monkeypatch):
    session = two_trials / "sub-01" / "ses-01"
    page = page_on(qtbot, session)
    begun: list[bytes] = []
    monkeypatch.setattr(page.export_task, "begin", lambda module, given: begun.append(given))
    click_on(page.report_button)
    job = pickle.loads(begun[0])
    assert (job.folder, job.report, job.sessions) == (two_trials / "results-1", True, (session,))


def test_an_export_is_whole_and_in_a_new_folder(page: AnalysePage, three: Results) -> None:
    (three.folder / "results-1").mkdir(exist_ok=True)
    page.show_message("10 files written", "good")  # of an export before
    click_on(page.people.chips["02"])
    page.keys()["export"]()
    assert page.cancel_button.isVisible() and not page.export_button.isEnabled()
    settle(page)
    assert page.message.text().startswith("Writing") and page.message.objectName() == "quiet"
    assert page.cancel_button.width() == page.cancel_button.sizeHint().width() and page.bar.width() == 160
    page.driver.until(lambda: page.message.text().endswith("results-2"))
    folder = three.folder / "results-2"
    assert {path.suffix for path in folder.iterdir()} == {".png", ".svg", ".pdf", ".csv"}
    exported = read_rows(folder / "trials.csv")
    assert len(exported) == 40 and page.folder_button.isVisible() and page.message.objectName() == "good"
    assert (folder / exported[0].recording).resolve() == three.folder / "sub-01/ses-01/trials/run-001.parquet"
    shutil.rmtree(folder)


@pytest.mark.parametrize("end", ["cancelled", "killed"])
def test_an_export_that_does_not_end_leaves_nothing(qtbot, page, three: Results, monkeypatch, end: str) -> None:
    before = sorted(three.folder.iterdir())
    begin = page.export_task.begin
    monkeypatch.setattr(page.export_task, "begin", lambda module, given: begin(module="held_export", given=given))
    monkeypatch.setenv("PYTHONPATH", str(Path(held_export.__file__).parent))
    page.export()
    partial = partial_name(page._job.folder)
    qtbot.waitUntil(partial.exists, timeout=120_000)
    if end == "killed":
        page.export_task._process.kill()
    else:
        click_on(page.cancel_button)
        assert page.export_task._process.poll() is not None
    said = "Nothing was written" if end == "killed" else "cancelled"
    qtbot.waitUntil(lambda: said in page.message.text(), timeout=60_000)
    assert sorted(three.folder.iterdir()) == before and not page.cancel_button.isVisibleTo(page)


class Painted(QObject):
    """Counts what is painted."""

    count = 0

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        self.count += event.type() == QEvent.Type.Paint
        return False


def test_an_idle_page_paints_nothing(qtbot, page: AnalysePage) -> None:
    painted = Painted()
    for widget in (page, *(plot.graph.viewport() for plot in page.plots)):
        widget.installEventFilter(painted)
    page.plots[0].graph.viewport().update()
    qtbot.waitUntil(lambda: painted.count > 0, timeout=60_000)

    def nothing_is_painted() -> bool:
        painted.count = 0
        QTest.qWait(200)
        return painted.count == 0

    qtbot.waitUntil(nothing_is_painted, timeout=60_000)  # what the page still had to do is done
    assert nothing_is_painted()
