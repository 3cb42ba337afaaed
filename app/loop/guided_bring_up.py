"""`phd bring-up` from the window: the loop does its steps, a tick at a time, and shows how far it is."""

from collections.abc import Callable

from app.ipc.messages import BringUp, BringUpShown, BroughtUp
from core.device_interface import DeviceSample, RealDevice
from experiments.bring_up import bring_up
from experiments.bring_up.record import brake_steps, make_record, state_of
from experiments.bring_up.step import Step
from experiments.bring_up.steps import steps_for
from experiments.session.journal import now


class GuidedBringUp:
    """The steps on one device, asked for by a person at the window."""

    def __init__(self, device: RealDevice, job: BringUp, sleep: Callable[[float], None]) -> None:
        self._device, self._by, self._is_ready = device, job.by, False
        self._runner = bring_up.BringUp(device, self, sleep)
        steps = steps_for(device.device, device.encoders, device.force_channels > 0, job.home)
        self.shown = BringUpShown("", "", False, (), tuple(step.title for step in steps))
        self._ticks = self._runner.run(steps)

    @property
    def sample(self) -> DeviceSample | None:
        """The newest of the device."""
        return self._runner.sample

    def tick(self) -> BroughtUp | None:
        """One exchange with the device; the record once all steps are done."""
        for _ in self._ticks:
            return None
        results = self._runner.results
        return BroughtUp(make_record(results, self._device.device, self._device.report(), self._by, now()),
                         brake_steps(results))  # fmt: skip

    def end(self) -> None:
        """Break off, with zero current."""
        self._ticks.close()

    def go_on(self) -> None:
        """The person says that it is done."""
        self._is_ready = True

    def ask(self, step: Step) -> None:
        self._is_ready = False
        self.shown = self.shown._replace(title=step.title, ask=step.ask, confirmed=step.confirmed)

    def is_ready(self) -> bool:
        return self._is_ready

    def show(self, result: bring_up.Result) -> None:
        row = (result.step.title, state_of(result), result.finding.saw, result.finding.advice)
        self.shown = self.shown._replace(results=(*self.shown.results, row))
