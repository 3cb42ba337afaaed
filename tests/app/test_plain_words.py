"""What is said is so: statuses, checks, energies, units, names, the board that was pulled out."""

import errno

import pytest
import serial

from app.ipc import messages as m
from app.ipc.messages import DeviceStatus
from app.session_server.preflight import check_real, check_sensor
from hardware.serial_port import _reason


def test_without_its_board_a_force_sensor_is_not_ready() -> None:
    there = DeviceStatus("four-brake", "B1", homed=True, zeroed=True, force_channels=6)
    assert check_sensor(there).state == m.GOOD == check_real(there, "").state
    gone = there._replace(problem="no sample for 200 ms")
    assert check_sensor(gone).state == m.WAITING and check_real(gone, "").state == m.BAD


DENIED, NOT_FOUND = "PermissionError(13, 'Access is denied.', None, 5)", "FileNotFoundError(2, 'No file.', None, 2)"


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (serial.SerialException("device reports readiness to read but returned no data"), "the board was unplugged"),
        (OSError(errno.EIO, "Input/output error"), "the board was unplugged"),
        (OSError(errno.ENXIO, "No such device or address"), "the board was unplugged"),
        (serial.SerialException(f"ClearCommError failed ({DENIED})"), "the board was unplugged"),
        (serial.SerialException(f"could not open port 'COM3': {DENIED}"), "another program is using it"),
        (serial.SerialException(f"could not open port 'COM3': {NOT_FOUND}"), "there is no such port"),
    ],
)
def test_what_is_wrong_with_a_port_is_said_alike_on_each_system(error: Exception, said: str) -> None:
    assert _reason(error) == said
