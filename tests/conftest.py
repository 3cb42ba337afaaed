"""What tests of the mechanics share."""

import gc
import os
import tempfile
from collections.abc import Iterator

import conclusions
import pytest
from devices import BENCH, COUPLED, FIXED, FiveBar, random_five_bar
from hypothesis import HealthCheck, settings

from experiments.analysis.sheet import PNG_DPI, STYLE

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")  # windows without a screen, as CI has them

#: no law depends on how long this machine takes for an example, and every run tries the same ones
settings.register_profile(
    "any machine", deadline=None, max_examples=50, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("any machine")

MANY = (*FIXED, *COUPLED, *(random_five_bar(seed) for seed in range(3)))


#: The files that take longest, the longest first: short ones fill the time that is left beside the last of them.
LONG = (
    "test_fault_matrix", "test_analyse_page", "test_sensitivity", "test_app_process", "test_compile_kernels",
    "test_scripted_session", "test_identify", "test_findings", "test_own_code", "test_export", "test_statistics",
    "test_study", "test_guard", "test_said_plainly", "test_paper_figures", "test_wire_clocks",
    "test_sandbox", "test_blind", "test_power_cut", "test_bench", "test_reference_board", "test_firmware",
    "test_real_trial", "test_odd_values", "test_disk_full", "test_launcher",
    "test_random_scenes", "test_hard_cases", "test_damage", "test_home_page", "test_run_page", "test_texts_on_screen",
    "test_repair", "test_emulate", "test_live_board", "test_live_kill", "test_live_run", "test_live_server",
    "test_live_lsl",
)  # fmt: skip


def pytest_configure(config: pytest.Config) -> None:
    """Before a test file is imported: what a test starts or allows is not remembered for the user."""
    own = tempfile.TemporaryDirectory(prefix="phd-tests-")
    config.add_cleanup(own.cleanup)
    os.environ["XDG_CONFIG_HOME"] = os.environ["XDG_DATA_HOME"] = own.name


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files come first, the others in their order."""
    places = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path.stem, len(LONG)))


def _name(bar: FiveBar) -> str:
    return bar.name.replace(" ", "-")


@pytest.fixture(scope="session", autouse=True)
def own_boards(tmp_path_factory: pytest.TempPathFactory) -> None:
    """A test sees no emulated boards but those of the tests of its process."""
    os.environ["TMPDIR"] = tempfile.tempdir = str(tmp_path_factory.mktemp("temporary"))


@pytest.fixture(scope="session", autouse=True)
def application() -> object:
    """Qt takes its scale from the environment once: before any test changes it, whichever test comes first."""
    from PySide6.QtWidgets import QApplication

    return QApplication.instance() or QApplication([])


@pytest.fixture(autouse=True)
def own_scale() -> Iterator[None]:
    """A verb that looks at the screen may scale Qt for its process: not for the tests after it."""
    before = os.environ.get("QT_SCALE_FACTOR")
    yield
    os.environ.pop("QT_SCALE_FACTOR", None)
    if before is not None:
        os.environ["QT_SCALE_FACTOR"] = before


@pytest.fixture(autouse=True)
def ordinary_scheduling() -> Iterator[None]:
    """A verb that takes the scheduling of a control loop is run in a process of its own, or not allowed to take it: the
    tests after it, and the programs that they start, would have it too, and hold up the machine.
    """
    yield
    has_it = not gc.isenabled()
    gc.enable()
    if hasattr(os, "sched_getscheduler") and os.sched_getscheduler(0) != os.SCHED_OTHER:
        has_it = True
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
    assert not has_it


@pytest.fixture(scope="session", autouse=True)
def _conclusions_left_out() -> Iterator[None]:
    """Studies draw no box plots and compute no error bars, but for tests that ask for them (`concluded`)."""
    with conclusions.left_out():
        yield


PDF_FONTS = STYLE["pdf.fonttype"]  # before `_coarse_prints`


@pytest.fixture(scope="session", autouse=True)
def _coarse_prints() -> Iterator[None]:
    """Figures have few dots, and letters as drawings, which is faster; but for tests that ask for `fine_prints`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.analysis.sheet.PNG_DPI", 30)
        patch.setitem(STYLE, "pdf.fonttype", 3)
        yield


@pytest.fixture
def fine_prints(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures as people get them."""
    monkeypatch.setattr("experiments.analysis.sheet.PNG_DPI", PNG_DPI)
    monkeypatch.setitem(STYLE, "pdf.fonttype", PDF_FONTS)


@pytest.fixture
def concluded() -> Iterator[None]:
    """Studies conclude themselves as they do for people."""
    with conclusions.whole():
        yield


@pytest.fixture(params=FIXED, ids=_name)
def five_bar(request: pytest.FixtureRequest) -> FiveBar:
    """The two shipped devices and the two bench devices."""
    return request.param


@pytest.fixture(params=BENCH, ids=_name)
def bench(request: pytest.FixtureRequest) -> FiveBar:
    """The two bench devices."""
    return request.param


@pytest.fixture(params=MANY, ids=_name)
def any_five_bar(request: pytest.FixtureRequest) -> FiveBar:
    """Shipped, bench and random devices."""
    return request.param
