"""A board in simulated time, for tests: told messages, ticked, and what it says read back."""

from hardware.emulated_board.board import FULL_BOARD, TICK_US, Board, Readings
from hardware.wire.frames import FrameDecoder, encode_frame
from hardware.wire.messages import AskHello, Command, Hello, Limits, Sample, SetLimits, State, layout_of, pack, unpack

STILL = Readings(counts=(0, 0, 0, 0), force=(0,) * 6)
FULL = (1000, 1000, 1000, 1000)
NO_LIMIT = (0, 0, 0, 0)


class SimulatedBoard:
    """A board, its time, and the host's side of the wire."""

    def __init__(self, hello: Hello = FULL_BOARD, kind: type[Board] = Board) -> None:
        self.board = kind(hello)
        self.layout = layout_of(hello)
        self.now_us = 0
        self.readings = STILL
        self.sequence = 0
        self.delay_us = 0  # of the next command
        self._decoder = FrameDecoder()

    @property
    def state(self) -> State:
        return self.board.state

    def tell(self, *told: tuple) -> list[tuple]:
        """Messages to the board now; its answers."""
        return self._read(self.board.receive(b"".join(encode_frame(pack(m)) for m in told), self.now_us))

    def command(self, *currents: int, mode: int = 1, step: int = 1) -> list[tuple]:
        """The next command."""
        self.sequence += step
        four = currents or (500, 500, 500, 500)
        return self.tell(Command(self.sequence, 10**9 + self.now_us - self.delay_us, mode, four))

    def tick(self, n: int = 1, **readings) -> list[tuple]:
        """n ticks with these readings; everything that was said."""
        said = []
        for _ in range(n):
            self.now_us += TICK_US
            self.readings = self.readings._replace(**readings)
            said += self._read(self.board.tick(self.readings, self.now_us))
        return said

    def start(self) -> "SimulatedBoard":
        """Out of Boot."""
        while self.state == State.BOOT:
            self.tick()
        return self

    def connect(self, current=FULL, speed=NO_LIMIT) -> Limits:
        """Hello and limits: Ready."""
        self.start()
        self.tell(AskHello(1))
        (limits,) = self.tell(SetLimits(current, speed))
        return limits

    def _read(self, data: bytes) -> list[tuple]:
        found = []
        for payload in self._decoder.feed(data):
            message = self.layout.unpack(payload) or unpack(payload)
            assert message is not None, payload.hex()
            found.append(message)
        return found


def samples(said: list[tuple]) -> list[Sample]:
    """The samples among what a board said."""
    return [message for message in said if isinstance(message, Sample)]
