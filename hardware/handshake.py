"""Whether the board that answers is the one of the device file, and the limits that it is given."""

import json
import math
import socket
import time

from core.device import Device
from core.files import InputError
from core.mechanism import JOINTS
from hardware.emulated_board.plug import EMULATED, LOOPBACK, emulated_ports
from hardware.sensing.samples import sensing_of
from hardware.wire.messages import SAMPLE_HZ, VERSION, WATCHDOG_US, Four, Hello, SetLimits, joints_of

#: rad/s, at which a joint is too fast (assumed; 9 m/s at the end of a 0.3 m link)
SPEED_MAX = 30.0
REWIRE_S = 0.2  # for an emulated board to be wired to another device and to start. Our choice


def check_hello(hello: Hello, device: Device) -> None:
    """InputError if this board does not match the device file."""
    where = f"the board ({hello.serial.decode(errors='replace') or 'without a number'})"
    if hello.version != VERSION:
        raise InputError(f"{where} speaks version {hello.version} of the protocol, this program version {VERSION}")
    if hello.sample_hz != SAMPLE_HZ or not 0 < hello.watchdog_ms <= WATCHDOG_US // 1000:
        raise InputError(f"{where} samples at {hello.sample_hz} Hz with a watchdog of {hello.watchdog_ms} ms")
    wired = wired_to(hello)
    if not wired:
        raise InputError(f"{where} does not say which device it is wired to: its firmware must name {device.name!r}")
    if wired != shortened(device):
        raise InputError(f"{where} is wired to the device {wired!r}, not to {device.name!r}")
    wanted = sensing_of(device)[0].counts
    has = tuple(n if hello.encoders >> i & 1 else 0 for i, n in enumerate(hello.counts_per_rev))
    if has != wanted or hello.encoders > 0b1111:
        raise InputError(f"{where} has encoders {_listed(has)}, device {device.name} says {_listed(wanted)}")
    missing = [JOINTS[i] for i in range(4) if device.brakes.present[i] and i not in joints_of(hello.brakes)]
    if missing or hello.brakes > 0b1111 or hello.force_channels > 6:
        raise InputError(f"{where} drives no brake at {', '.join(missing) or 'those joints'}")
    for joint, wanted_mA, most_mA in zip(JOINTS, currents_of(device), hello.current_max_mA, strict=True):
        if wanted_mA > most_mA:  # it would brake less than the controllers count on
            raise InputError(
                f"{where} gives the brake at {joint} at most {1e-3 * most_mA:g} A, the brake file of device "
                f"{device.name} says {1e-3 * wanted_mA:g} A"
            )


def _listed(counts: tuple[int, ...]) -> str:
    return ", ".join(f"{JOINTS[i]} = {n}" for i, n in enumerate(counts) if n) or "none"


def limits_of(hello: Hello, device: Device) -> SetLimits:
    """The limits for the board: the currents of the brake files, and a speed for each encoder."""
    speeds = tuple(round(SPEED_MAX / (2.0 * math.pi) * n) for n in hello.counts_per_rev)
    return SetLimits(currents_of(device), speeds)


def currents_of(device: Device) -> Four:
    """The largest currents of the brake files, mA; 0: no brake."""
    return tuple(round(1000.0 * float(most)) for most in device.brakes.current_max)


def wired_to(hello: Hello) -> str:
    return hello.device.decode(errors="replace")


def shortened(device: Device) -> str:
    """The name of a device, cut to the length that a board stores."""
    return device.name.encode()[:24].decode(errors="replace")


def rewire_emulated(hello: Hello, port: str, device: Device) -> bool:
    """Ask an emulated board of this user to be wired to a device; False: it is another board."""
    number = emulated_ports().get(port)
    if not hello.serial.startswith(EMULATED.encode()) or number is None:
        return False
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as orders:
        orders.sendto(json.dumps({"device": device.name}).encode(), (LOOPBACK, number))
    time.sleep(REWIRE_S)
    return True
