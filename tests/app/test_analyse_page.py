"""The page Analyse: points that can be read and opened, filters, timeouts above the scale, an export that is whole."""

import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import fake_client
import numpy as np
import pytest
from own_files import MEASURE, measures_of
from page_driver import LEFT, PageDriver, texts
from processes import children
from protocols import short
from PySide6.QtCore import QEvent, QObject, QPointF
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QApplication, QPushButton
from sessions import closed_session

from app.ipc import messages as m
from app.window.analyse.analyse_page import TRIAL, AnalysePage
from app.window.analyse.box_plot import ChartPlot
from app.window.widgets import palette, theme
from app.window.widgets.cards import EXCLUDE
from app.window.widgets.parts import KeyButton
from app.window.widgets.theme import COLOURS
from experiments.analysis.charts import PERSON, POOLED
from experiments.analysis.own_measures import metrics_in
from experiments.analysis.trials_table import TrialRow, as_rows, as_table
from experiments.export.results import Results, read_results
from experiments.store.files import rows_of
from experiments.store.session import Session
from tests.support.rows import put_session, read_rows, with_measures

#: of the plan, the first trial of each controller, device and path: runs 1 to 10 and 31 to 40
PLANNED = [*fake_client.PLAN[:10], *fake_client.PLAN[30:40]]


def results_of(participant: str, seed: int) -> list[TrialRow]:
    """A participant's twenty trials, with scores that depend on the controller and a little on chance."""
    generator = np.random.default_rng(seed)
    return [
        with_measures(
            replace(fake_client.result(trial), participant=participant),
            path_error_m=1e-3 * trial.controller + 1e-4 * generator.random(),
            mean_tip_force_N=trial.controller + generator.random(),
            acceleration_dft_sum=30.0 * trial.controller + generator.random(),
        )
        for trial in PLANNED
    ]


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """The results of three participants."""
    folder = tmp_path_factory.mktemp("three")
    for seed, participant in enumerate(("01", "02", "03")):
        put_session(folder, participant, results_of(participant, seed))
    return read_results(folder)._replace(controllers=fake_client.PRESETS, lengths={1: 0.2, 2: 0.17})


@pytest.fixture(scope="module")
def kept() -> Iterator[PageDriver]:
    driver = PageDriver(AnalysePage, (1280, 640))
    yield driver
    driver.close()


@pytest.fixture
def page(kept: PageDriver, three: Results) -> AnalysePage:
    """The page with these results, as it is at first: the same for all tests."""
    page = kept.page
    while close := page.to_close():
        close()
    page.chosen = None
    page.timeouts.setChecked(False)
    page.logarithmic.setChecked(True)
    page.show_results(three._replace(trials=as_table([]), configurations=(), own=()))
    page.show_page(POOLED)
    page.show_results(three)
    return page


@pytest.fixture
def page_on() -> Iterator[Callable[[object], PageDriver]]:
    """Opens pages of data folders, once these have been read."""
    opened = []

    def open_page(what: object) -> PageDriver:
        opened.append(driver := PageDriver(AnalysePage, (1280, 640)))
        driver.page.begin(what)
        driver.until(lambda: driver.page.results is not None)
        return driver

    yield open_page
    for driver in opened:
        driver.close()


def show_rows(page: AnalysePage, rows: Iterable[TrialRow]) -> None:
    page.show_results(page.results._replace(trials=as_table(rows)))


def click_on(widget: QAbstractButton) -> None:
    QTest.mouseClick(widget, LEFT)


def click(plot: ChartPlot, x: float, y: float) -> None:
    """A click on a place of the plot, in its own units."""
    QApplication.processEvents()
    place = plot.graph.mapFromScene(plot.item.vb.mapViewToScene(QPointF(x, y)))
    QTest.mouseClick(plot.graph.viewport(), LEFT, pos=place)


def shown_in(page: AnalysePage) -> list[TrialRow]:
    return [] if page.trials is None else as_rows(page.trials)


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
    "of a blind session": State(lambda row: replace(row, controller=f"K{row.controller}"), in_boxes=0, never=("●",)),
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
    drawn = page.plots[0].points.points()
    if name in ("all", "linear"):
        rows = {row.run: 1e3 * row.value("path_error_m") for row in shown_in(page) if row.participant == "03"}
        placed = {run: np.log10(mm) if name == "all" else mm for run, mm in rows.items()}
        assert {point.data().row.run: point.pos().y() for point in drawn} == pytest.approx(placed)
        assert {point.data().row.path: point.symbol() for point in drawn} == {1: "o", 2: "t1"}
    if name == "of a blind session":
        assert {point.pen().color().name() for point in drawn} == {theme.shade(COLOURS.quiet).name()}
    if name == "one timed out":
        (cross,), plot = page.plots[0].crosses.points(), page.plots[0]
        assert np.log10(plot.chart.highest) < cross.pos().y() < plot.item.viewRange()[1][1] < 1.0
        assert "65 mm · time was up" in cross.data().text
        plot.item.setYRange(1.0, 2.0, padding=0.0)
        assert 1.0 < plot.crosses.points()[0].pos().y() < 2.0, "it stays above whatever part of the scale is seen"


def test_it_follows_the_open_session_and_says_where_nothing_can_be_read(page_on, tmp_path: Path) -> None:
    data = tmp_path / "data"
    session = put_session(data, "02", results_of("02", 2)[:-1])
    rows = rows_of(session)
    driver = page_on(data)
    page = driver.page
    page.show_opened(fake_client.opened("02", folder=str(session)))
    page.begin()
    driver.until(lambda: len(shown_in(page)) == 19)
    put_session(data, "02", [*rows, results_of("02", 2)[-1]])
    page.show_snapshot(fake_client.ready(20))
    driver.until(lambda: len(shown_in(page)) == 20)
    page.begin(tmp_path / "none")
    driver.until(lambda: "no such folder" in page.empty.text())
    lost = tmp_path / "lost"
    lost.mkdir()
    page.begin(lost)
    driver.until(lambda: "Nothing is recorded" in page.empty.text())
    assert not page.export_button.isEnabled() and not page.tabs.isEnabled()
    for person in ("01", "02"):
        trials = lost / f"sub-{person}" / "ses-01" / "trials"
        trials.mkdir(parents=True)
        (trials / "run-001.parquet").touch()
    page.begin(lost)
    driver.until(lambda: f"No trial in {lost} can be read." in page.empty.text())
    assert [line[:6] for line in page.empty.text().split("\n")[2:]] == ["sub-01", "sub-02"], "a line each"


def test_the_legend_names_each_controller_in_the_colour_of_its_points_in_both_themes(page: AnalysePage) -> None:
    for name in ("light", "dark"):
        palette.choose(name)
        theme.colour_all()
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
    menu = people.menu.menu()
    menu.popup(page.mapToGlobal(page.rect().center()))
    for who in ("07", "08"):
        click_on(people.chips[who])
    assert menu.isVisible() and people.menu.text().startswith("Participants: 22 of 24") and len(shown_in(page)) == 88
    every, none = menu.findChildren(QPushButton, "small")
    click_on(none)
    click_on(people.chips["12"])
    assert {row.participant for row in shown_in(page)} == {"12"}
    click_on(every)
    assert len(shown_in(page)) == 96
    menu.close()


def test_error_against_force_shows_the_medians_of_the_chosen_trials(page: AnalysePage) -> None:
    click_on(page.people.chips["02"])
    cells = page.trials.groupby(["controller", "configuration"])[["mean_tip_force_N", "path_error_m"]].median()
    medians = {(round(force, 9), round(np.log2(1e3 * error), 9)) for force, error in cells.itertuples(index=False)}
    assert {(round(p.pos().x(), 9), round(p.pos().y(), 9)) for p in page.force.circles.points()} == medians


def test_a_click_on_a_point_opens_its_trial_and_rings_it_in_all_plots_and_steps_go_on_from_it(page) -> None:
    row = shown_in(page)[27]
    show_rows(page, [replace(each, recording="") if each == row else each for each in shown_in(page)])
    row = replace(row, recording="")
    point = next(p for p in page.plots[1].chart.points if p.row == row)
    click(page.plots[1], point.x, point.y)
    assert page.chosen == row and page.side.isVisible() and page.side.title.text() == f"Participant 02, trial {row.run}"
    assert "no recording" in page.side.note.text() and not page.charts.isVisible()
    page.to_close()()
    for plot in page.plots[:3]:
        (ring,), wanted = plot.ring.points(), next(p for p in plot.chart.points if p.row == row)
        place = wanted.x, np.log10(wanted.y) if plot.chart.logarithmic else wanted.y
        assert (ring.pos().x(), ring.pos().y()) == pytest.approx(place)
    page.show_page(PERSON)
    assert len(page.plots[2].ring.points()) == 1
    page.show_page(TRIAL)
    assert page.side.title.text() == f"Participant 02, trial {row.run}", "the one that was looked at last"
    page.to_close()()
    assert page.tabs.value() == PERSON and not page.side.isVisible() and page.to_close() is None
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
    plot = page.plots[0]
    point = next(p.data() for p in plot.points.points() if p.data().row.participant == "02")
    error_mm = 1e3 * point.row.value("path_error_m")
    assert (
        point.text == f"Participant 02 · controller {point.row.controller} · trial {point.row.run} · {error_mm:.3g} mm"
    )
    placed = plot.chart.boxes[2]
    cell = placed.controller, page.results.configurations[placed.look]
    of_box = [1e3 * r.value("path_error_m") for r in shown_in(page) if (r.controller, r.configuration) == cell]
    said = plot.read_at(QPointF(placed.x, np.log10(placed.box.median)))
    assert said.startswith(f"Box of 6: median {np.median(of_box):.3g} mm, quartiles ") and len(of_box) == 6
    assert plot.read_at(QPointF(placed.x, np.log10(1.01 * placed.box.q3))) == ""


@pytest.fixture(scope="module")
def two_trials(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data folder of a session of two trials."""
    data = tmp_path_factory.mktemp("two") / "data"
    closed_session(data, 2, protocol=short())
    return data


def exclude(page: AnalysePage, reason: int) -> None:
    """Press the button, and of what it asks the reason in this place."""
    page.side.exclude.click()
    page.cards.question.findChildren(KeyButton)[reason].click()


def test_a_recording_opens_alone_among_its_folders_trials_and_is_excluded_by_whoever_has_its_session(
    page_on, two_trials: Path, tmp_path: Path
) -> None:
    data = shutil.copytree(two_trials, tmp_path / "data")
    session = data / "sub-01" / "ses-01"
    driver = page_on(session / "trials" / "run-002.parquet")
    page, side = driver.page, driver.page.side
    driver.until(lambda: side.trial is not None and bool(shown_in(page)))
    assert page.results.folder == data.resolve() and side.title.text() == "Participant 01, trial 2"
    page.keys()["start"]()
    assert side.playing
    page.end()
    assert not side.playing, "another page is at the front"
    assert side.isVisible() and not page.charts.isVisible() and not page.axis.isVisible()

    page.show_opened(fake_client.opened("01", folder=str(session)))
    exclude(page, 0)
    assert driver.sent == [m.Exclude(2, EXCLUDE.reasons[0])], "the session server has it"
    page.show_snapshot(fake_client.ready(2, notice="A trial is running.", notice_bad=True))
    assert side.note.text() == "A trial is running."
    page.show_opened(fake_client.opened("", folder=str(data)))
    other = Session.resume(data, "01")
    try:
        exclude(page, 0)
        driver.until(lambda: "is using this folder" in side.note.text())
    finally:
        other.close()
    assert [row.status for row in rows_of(session)] == ["done", "done"] and side.exclude.isVisible()
    exclude(page, 1)
    driver.until(lambda: EXCLUDE.reasons[1] in side.note.text())
    assert not side.exclude.isVisible() and "excluded" in side.about.text()
    assert [row.run for row in shown_in(page)] == [1]
    assert [row.status for row in read_rows(session / "trials.csv")] == ["done", "excluded"]
    page.to_close()()
    assert page.charts.isVisible() and page.tabs.value() == POOLED and page.axis.isVisible()


def test_measures_of_ones_own_are_chosen_by_chips_and_an_export_is_whole_and_in_a_new_folder(
    page: AnalysePage, kept: PageDriver, three: Results
) -> None:
    trials = as_table(with_measures(row, late_error_mm=-1.0 * row.run) for row in shown_in(page))
    page.show_results(three._replace(trials=trials, own=metrics_in(measures_of("my_measure", MEASURE))))
    assert page.measures.chosen == {"path_error_m", "mean_tip_force_N", "acceleration_dft_sum", "late_error_mm"}
    for measure in ("path_error_m", "mean_tip_force_N", "acceleration_dft_sum"):
        click_on(page.measures.chips[measure])
    (shown,) = [plot for plot in page.plots if not plot.isHidden()]
    assert shown.title.text() == "Late error" and shown.chart.lowest == -40.0
    assert min(point.pos().y() for point in shown.points.points()) == -40.0

    (three.folder / "results-1").mkdir()
    page.show_message("10 files written", "good")  # of an export before
    click_on(page.people.chips["02"])
    page.keys()["export"]()
    assert page.cancel_button.isVisible() and not page.export_button.isEnabled()
    assert page.message.text().startswith("Writing") and page.message.objectName() == "quiet"
    kept.until(lambda: page.message.text().endswith("results-2"))
    folder = three.folder / "results-2"
    assert {path.suffix for path in folder.iterdir()} == {".png", ".svg", ".pdf", ".csv"}
    assert [path.suffix for path in folder.glob("*late_error*.svg")] == [".svg"]
    exported = read_rows(folder / "trials.csv")
    assert len(exported) == 40 and page.folder_button.isVisible() and page.message.objectName() == "good"
    assert (folder / exported[0].recording).resolve() == three.folder / "sub-01/ses-01/trials/run-001.parquet"


def test_a_report_goes_beside_the_sessions_and_one_that_does_not_end_leaves_nothing(page_on, two_trials: Path) -> None:
    driver = page_on(two_trials / "sub-01" / "ses-01")
    page, before, others = driver.page, sorted(two_trials.rglob("*")), children(os.getpid())
    click_on(page.report_button)
    click_on(page.cancel_button)
    driver.until(lambda: "cancelled" in page.message.text())
    click_on(page.report_button)
    driver.until(lambda: [path for path in two_trials.iterdir() if "results-1" in path.name])
    (writing,) = set(children(os.getpid())).difference(others)
    os.kill(writing, 9)
    driver.until(lambda: "Nothing was written" in page.message.text())
    assert sorted(two_trials.rglob("*")) == before and not page.cancel_button.isVisible()


class Painted(QObject):
    """Counts what is painted."""

    count = 0

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        self.count += event.type() == QEvent.Type.Paint
        return False


def test_an_idle_page_paints_nothing(page: AnalysePage, kept: PageDriver) -> None:
    painted = Painted()
    for widget in (page, *(plot.graph.viewport() for plot in page.plots)):
        widget.installEventFilter(painted)
    page.plots[0].graph.viewport().update()
    kept.until(lambda: painted.count > 0)

    def nothing_is_painted() -> bool:
        painted.count = 0
        QTest.qWait(100)
        return painted.count == 0

    kept.until(nothing_is_painted)  # what the page still had to do is done
    assert nothing_is_painted()
