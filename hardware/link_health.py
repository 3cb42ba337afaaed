"""What a link has counted, for the device page and for each recording."""

import math
from dataclasses import dataclass, field

from hardware.frames import FrameCounts
from hardware.sensing import BoardSensing


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
    round_trip_s: float = math.inf  # the least, of heartbeats
    frames: FrameCounts = field(default_factory=FrameCounts)  # of the present connection

    def report(self, sensing: BoardSensing | None) -> dict:
        """All of it, with the clock model and the board's number, as JSON holds it."""
        about = {name: value for name, value in vars(self).items() if name not in ("frames", "round_trip_s")}
        about["round_trip_s"] = self.round_trip_s if math.isfinite(self.round_trip_s) else None
        about["frames"] = {**vars(self.frames), "bad": self.frames.bad}
        if sensing is not None:
            about["clock"] = sensing.clock.fit._asdict()
            about["board"] = sensing.hello.serial.decode(errors="replace")
        return about
