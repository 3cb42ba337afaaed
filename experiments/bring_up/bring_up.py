"""Runs the steps on a real device, tick by tick. However it ends, the last thing that it is told is zero current."""

import contextlib
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, Protocol, TypeAlias, TypeVar

from core.device_interface import DeviceError, DeviceSample, RealDevice
from core.faults import advice, cause_of
from experiments.bring_up.step import NO_CURRENT, Currents, Finding, Observed, Row, Step
from experiments.bring_up.steps import PATIENCE_S, missing_needs

#: A generator that yields after each exchange with the device, one a tick, and returns an outcome.
Outcome = TypeVar("Outcome")
Ticks: TypeAlias = Generator[None, None, Outcome]

LOOK_ROWS = 25  # between two looks at whether a step begins or ends
NO_SAMPLE_S = 3.0  # after which the device is lost
KEPT_S = 1.0  # of rows, while a step waits to begin


class Builder(Protocol):
    """The person at the bench."""

    def ask(self, step: Step) -> None:
        """Show what is to be done."""

    def is_ready(self) -> bool:
        """Whether the person has said that it is done; never waits."""

    def show(self, result: "Result") -> None:
        """Show how a step ended."""


class Result(NamedTuple):
    """How one step ended."""

    step: Step
    done: bool  # False: what it needs has not passed
    finding: Finding
    took_s: float


class StepFailed(Exception):
    """A step was ended by the device; one sentence, and what to do."""

    def __init__(self, why: str) -> None:
        super().__init__(why)
        self.finding = Finding(False, why, advice(why) or "Look at board, cable and supply, and begin again.")


class BringUp:
    """One board, from the first step to the last."""

    def __init__(self, device: RealDevice, builder: Builder, sleep: Callable[[float], None] = time.sleep) -> None:
        """device: open. sleep: of the machine, but for tests."""
        self._device, self._builder, self._sleep = device, builder, sleep
        self._rows: list[Row] = []
        self.sample: DeviceSample | None = None  # the newest
        self._heard = device.clock()
        self._report_before: dict[str, Any] = {}
        self.results: list[Result] = []

    def run(self, steps: Sequence[Step]) -> Ticks[None]:
        """Every step whose needs have passed, into `results`. The currents are zero at the end, whatever ends it."""
        try:
            for step in steps:
                passed = [result.step.name for result in self.results if result.finding.passed]
                begun, lost = self._device.clock(), self._device.problem
                if why := f"not done: {lost}" if lost else missing_needs(step, passed):
                    result = Result(step, False, Finding(False, why), 0.0)
                else:
                    finding = yield from self._try(step)
                    result = Result(step, True, finding, self._device.clock() - begun)
                self.results.append(result)
                if not lost:  # said once, by the step in which it was lost
                    self._builder.show(result)
        finally:
            with contextlib.suppress(DeviceError):
                self._device.exchange(NO_CURRENT)

    def _try(self, step: Step) -> Ticks[Finding]:
        try:
            return (yield from self._do(step))
        except StepFailed as unfit:
            return unfit.finding
        except DeviceError as error:
            return StepFailed(cause_of(error)).finding
        finally:
            self._device.exchange(NO_CURRENT)

    def _do(self, step: Step) -> Ticks[Finding]:
        """Ask, wait, drive, judge."""
        self._heard = self._device.clock()
        self._builder.ask(step)
        if step.confirmed:
            yield from self._wait(self._builder.is_ready, may_fault=True)
        self._reset()
        if step.homes is not None:
            self._device.home(step.homes)
        if step.zeroes:
            self._device.zero()
        self._rows.clear()
        self._report_before = self._device_report()
        yield from self._wait(lambda: len(self._rows) > 0 and step.begins(self._observed()), step.may_fault)
        self._rows.clear()
        begun, largest = self._device.clock(), self._observed().largest
        looked = 0
        while (t := self._device.clock() - begun) < step.lasts_s:
            self._exchange(step.drive(t, largest), step.may_fault)
            yield
            if len(self._rows) >= looked + LOOK_ROWS:
                looked = len(self._rows)
                if step.ends(self._observed()):
                    break
        if step.silent_s:
            self._sleep(step.silent_s)
            for _ in range(50):
                self._exchange(NO_CURRENT, may_fault=True)
        if len(self._rows) < 2:
            raise StepFailed("no sample came")
        self._device.exchange(NO_CURRENT)
        self._report_before = self._device_report()
        with ThreadPoolExecutor(1) as judging:  # a board that hears nothing for a second ends the connection
            finding = judging.submit(step.judge, Observed(list(self._rows), self._device.device, self._report_before))
            while not finding.done():
                self._device.exchange(NO_CURRENT)
                yield
        return finding.result()

    def _reset(self) -> None:
        """Reset a fault that an earlier step has caused on purpose."""
        self._exchange(NO_CURRENT, may_fault=True)
        if self._rows and self._rows[-1].sample.fault:
            self._device.reset()
        self._rows.clear()

    def _wait(self, until: Callable[[], bool], may_fault: bool = False) -> Ticks[None]:
        """Exchange without current until `until` holds. StepFailed: it does not within `PATIENCE_S`."""
        end, looked = self._device.clock() + PATIENCE_S, 0
        while self._device.clock() < end:
            self._exchange(NO_CURRENT, may_fault)
            yield
            del self._rows[: -round(1e3 * KEPT_S)]
            looked += 1
            if looked % LOOK_ROWS == 0 and until():
                return
        raise StepFailed(f"nothing was done for {PATIENCE_S:g} s")

    def _exchange(self, currents: Currents, may_fault: bool = False) -> None:
        """One tick. StepFailed: the device is lost, or has latched a fault."""
        device = self._device
        device.exchange(currents)
        now = device.clock()
        for sample in device.samples():
            self._rows.append(Row(sample, currents, now))
            self.sample, self._heard = sample, now
        if problem := device.problem:
            raise StepFailed(problem)
        if now - self._heard > NO_SAMPLE_S:
            raise StepFailed("no sample came")
        if not may_fault and self._rows and (fault := self._rows[-1].sample.fault):
            raise StepFailed(fault)

    def _device_report(self) -> dict[str, Any]:
        device = self._device
        return device.report() | {"encoders": device.encoders, "force_channels": device.force_channels}

    def _observed(self) -> Observed:
        return Observed(self._rows, self._device.device, self._report_before)
