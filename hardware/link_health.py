"""What a link has counted, for the device page and for each recording."""

import math
from dataclasses import dataclass, field

from hardware.connection import Connection
from hardware.sensing.samples import BoardSensing
from hardware.wire.frames import FrameCounts
from hardware.wire.messages import State, joints_of


@dataclass
class LinkHealth:
    """Counted since the link was opened."""

    samples: int = 0
    lost: int = 0  # samples that never came
    repeated: int = 0  # .. that came again, or after a newer one
    late_commands: int = 0  # samples that say that the board did not obey a command that waited
    refused: int = 0
    clamped: int = 0  # exchanges whose currents had to be put right: beyond a limit, below zero, not finite
    not_closed: int = 0  # samples whose encoders are of no pose
    lost_links: int = 0
    begun_anew: int = 0  # of these: connections given up because the board took, or would take, all commands for late
    round_trip_s: float = math.inf  # the least, of heartbeats
    frames: FrameCounts = field(default_factory=FrameCounts)  # of the present connection

    def report(self, sensing: BoardSensing | None, connection: Connection | None) -> dict:
        """All of it, with the clock model and what the board says of itself, as JSON holds it."""
        about = {name: value for name, value in vars(self).items() if name not in ("frames", "round_trip_s")}
        about["round_trip_s"] = self.round_trip_s if math.isfinite(self.round_trip_s) else None
        about["frames"] = {**vars(self.frames), "bad": self.frames.bad}
        if connection is not None:
            about["not_understood"], about["not_taken"] = connection.not_understood, connection.wire.not_taken
        if sensing is not None:
            about["zero"] = sensing.zero._asdict() if sensing.zero.samples else None
            about["clock"] = sensing.clock.fit._asdict()
            about["board_time_back"] = sensing.clock.went_back  # since the board's last start
            hello = sensing.hello
            about["board"] = hello.serial.decode(errors="replace")
            about["firmware"] = ".".join(map(str, hello.firmware))
            about["protocol"] = hello.version
            about["starts"] = hello.starts
            about["state"] = State(sensing.state).name if sensing.state in set(State) else f"state {sensing.state}"
            about["counts_per_rev"] = [hello.counts_per_rev[i] for i in joints_of(hello.encoders)]
        return about
