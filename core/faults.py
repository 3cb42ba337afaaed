"""What can go wrong with a device, its board, its loop or its recording: a code, words, and what to do about it.

A fault is carried as a `Cause`: its words, which know the code of the fault. No text is searched to find out what
happened.
"""

from typing import NamedTuple, Self

ON = "then turn the brakes on"
FOUND = "it is found again by itself"
TO_THE_JIG = "Look at the encoders' couplings, put the handle into its jig and home them."


class FaultWords(NamedTuple):
    """One row of the table."""

    words: str  # in braces: what is filled in where it happens
    advice: str = ""  # one sentence; "": where it is shown something else says what to do


FAULTS = {
    # latched on the board
    "watchdog": FaultWords(
        "the board got no command for 50 ms",
        f"Look at the board's cable; if it is well, close other programs, {ON}.",
    ),
    "over-current": FaultWords(
        "a brake drew more current than its limit",
        f"Switch off the brakes' supply, look at that amplifier and its wires, {ON}.",
    ),
    "over-speed": FaultWords(
        "a joint turned faster than its limit", f"Let go of the handle, look at the encoders' couplings, {ON}."
    ),
    "bad-encoder": FaultWords("an encoder's signal is bad", f"Look at the encoder's head and plug, {ON}."),
    "force-saturated": FaultWords(
        "the force sensor is at the end of its range",
        f"The force exceeds the limit: push less. If nobody pushed, look at the sensor's cable, {ON}.",
    ),
    "brown-out": FaultWords(
        "the supply voltage was too low and the board started anew",
        f"Look at the board's supply, {ON} and home the encoders.",
    ),
    "started-again": FaultWords(
        "the board was powered up again, though its number of starts is still {starts}",
        f"Home the encoders and take the zero of the force anew, {ON}; its firmware must count every power-up.",
    ),
    "host-request": FaultWords("stopped by the host or the emergency stop", "Turn the brakes on when it is safe."),
    "emergency-stop": FaultWords(
        "the emergency stop has cut the supply of the brakes",
        "Release it, press the start button of the supply, then turn the brakes on again.",
    ),
    "unknown": FaultWords(
        "the board reports unknown fault {number}", "Look at the board: it knows faults that this program does not."
    ),
    # of the line to the board
    "no-sample": FaultWords("no sample for {ms:.0f} ms", f"Look at the board's cable and supply; {FOUND}."),
    "silent-in-trial": FaultWords(
        "no sample came from the board for {ms:.0f} ms", f"Look at the board's cable and supply; {FOUND}."
    ),
    "port": FaultWords("serial port {name}: {what}", "Plug the board in again: it is found by itself."),
    "no-board": FaultWords("{name}: no board answers there", f"Look at the board's cable and supply; {FOUND}."),
    "board-left": FaultWords(
        "the board ended the connection: it had heard nothing for a second", f"Nothing has to be done: {FOUND}."
    ),
    # of the sensors
    "not-homed": FaultWords("the encoders have not been homed", "Put the handle into its jig and home the encoders."),
    "contradict": FaultWords("the encoders contradict each other: one of them may be stuck", TO_THE_JIG),
    "no-pose": FaultWords("the encoder counts match no position of the linkage: check the homing", TO_THE_JIG),
    "out-of-place": FaultWords(
        "the handle was where the device file says it cannot be: check the homing",
        "Look at the encoders' couplings and take up the session anew to home them.",
    ),
    "force-not-finite": FaultWords("the hand force was not finite", "Look at the force sensor's cable."),
    # of a trial
    "start-not-reached": FaultWords("the start was not reached in time", "Show the way to the start."),
    "too-fast": FaultWords("the handle moved faster than {speed_max:g} m/s", "Ask for slower movements."),
    "disobeyed": FaultWords(
        "the brakes did not get the currents that were asked for",
        "Look at the board, the brakes' supply and the amplifiers.",
    ),
    "trapped": FaultWords(
        "a hand pushed with more than {force:g} N for {time:g} s against a full lock: the brakes let go",
        "See that the hand is free and well.",
    ),
    "controller-failed": FaultWords(
        "the controller's file raised an error or used an index beyond its array",
        "Correct the file and check it with phd check-controller.",
    ),
    "decision-undeclared": FaultWords(
        "the controller's file returned a decision that its ALGORITHM does not declare",
        "Declare the decision or correct what decide returns, then check the file with phd check-controller.",
    ),
    "brakes-off": FaultWords("brakes off: {why}"),
    # of this computer
    "server-silent": FaultWords(
        "the process that records did not answer for two seconds", "This computer was held up: close other programs."
    ),
    "disk-too-slow": FaultWords(
        "the disk could not keep up: nothing was written for {seconds} s", "Free the disk of other work."
    ),
    "recording-failed": FaultWords(
        "the recording failed: {why}",
        "Make room on the disk, or let the folder be written to again, and what is missing is written by itself.",
    ),
    "folder-gone": FaultWords(
        "{what}",
        "Bring it back (connect its disk, take it out of the wastebasket), and what is missing is written by itself.",
    ),
    "loop-died": FaultWords("the control loop ended unexpectedly", "Nothing has to be done: it is started again."),
    "loop-hung": FaultWords("the control loop hung and was ended", "Nothing has to be done: it is started again."),
    "no-loop": FaultWords(
        "the control loop cannot be started: it died {times} times while it was being prepared",
        "Start again and resume the session.",
    ),
}


class Cause(str):
    """Why something ended or does not work, in words that know the code of their fault."""

    code: str  # of FAULTS

    def __new__(cls, words: str, code: str) -> Self:
        """code: of FAULTS."""
        made = super().__new__(cls, words)
        made.code = code
        return made

    def __getnewargs__(self) -> tuple[str, str]:  # type: ignore[override]
        """To another process with its code."""
        return str(self), self.code


def cause(code: str, **about: object) -> Cause:
    """A fault that has happened. about: what its words leave open."""
    return Cause(FAULTS[code].words.format(**about), code)


def after(words: str, why: str) -> str:
    """A reason with these words before it; a fault stays the fault that it is."""
    return Cause(f"{words}{why}", why.code) if isinstance(why, Cause) else f"{words}{why}"


def advice(why: str) -> str:
    """What to do about a fault; "" where somebody decided so."""
    return FAULTS[why.code].advice if isinstance(why, Cause) else ""


def cause_of(error: Exception) -> str:
    """Why an error came, which may be a fault."""
    return error.args[0] if error.args and isinstance(error.args[0], str) else str(error)
