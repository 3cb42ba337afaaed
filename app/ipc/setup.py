"""What a bench is started with."""

import json
from pathlib import Path
from typing import NamedTuple, Self

#: operator: a simulated person, for sessions without a hand; hid: a six-axis device whose deflection is the force
MOUSE, OPERATOR, HID = "mouse", "operator", "hid"


class Setup(NamedTuple):
    """Choices of the command line; None: as the protocol says."""

    data_dir: Path
    protocol: str = "paper"  # a shipped one by name, or a file
    devices: tuple[str, ...] | None = None
    rules: str | None = None
    low_gain: float | None = None  # N s/m
    seed: int | None = None
    hand: str = MOUSE
    participant: str = ""  # to be offered first; "": the first without a session
    link: str = ""  # serial port of a device on the bench, or "PORT netft:HOST"; "": simulated
    real_time: bool = True  # try scheduling that needs a privilege
    sync: bool = True  # wait for the disk itself
    patience_s: float = 60.0  # that a conductor with an open session waits for another window. Our choice

    def clash(self, running: Self) -> str:
        """What is asked for by name and differs from the bench that runs on the data folder already; "": nothing."""
        words = {"protocol": "the protocol", "devices": "--device", "rules": "--rules", "low_gain": "--low-gain",
                 "seed": "--seed", "hand": "--input", "link": "--link"}  # fmt: skip
        for name, word in words.items():
            asked, there = getattr(self, name), getattr(running, name)
            if asked != self._field_defaults[name] and asked != there:
                return (
                    f"{self.data_dir}: a bench is running there already, {word} being "
                    f"{' '.join(there) if isinstance(there, tuple) else there or 'as the protocol says'}: close its "
                    f"window first, leave {word} out to take it over, or choose another --data-dir"
                )
        return ""

    def to_json(self) -> str:
        """As text, for a command line."""
        return json.dumps({**self._asdict(), "data_dir": str(self.data_dir)})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The same again."""
        fields = json.loads(text)
        devices = fields["devices"]
        return cls(**{**fields, "data_dir": Path(fields["data_dir"]), "devices": devices and tuple(devices)})
