"""What the experimenter can do about whatever ended a trial or keeps the brakes off: a sentence for each cause."""

ALLOW = "then allow the brakes"
#: part of a cause, as `trial`, `tick`, `samples`, `trial_runner` and `serial_port` word it -> what to do about it.
#: The first that fits counts.
REMEDIES = {
    "no command for 50 ms": f"Look at the board's cable; if it is well, close other programs, {ALLOW}.",
    "more current than its limit": f"Switch off the brakes' supply, look at that amplifier and its wires, {ALLOW}.",
    "a joint turned faster": f"Let go of the handle, look at the encoders' couplings, {ALLOW}.",
    "an encoder's signal is bad": f"Look at the encoder's head and plug, {ALLOW}.",
    "the force sensor is at the end": f"Nobody may push so hard; if nobody did, look at the sensor's cable, {ALLOW}.",
    "the supply voltage was too low": f"Look at the board's supply, {ALLOW} and home the encoders.",
    "stopped by the host": "Allow the brakes when its cause is past.",
    "unknown fault": "Look at the board: it knows faults that this program does not.",
    "no sample": "Look at the board's cable and supply; it is found again by itself.",
    "serial port": "Plug the board in again: it is found by itself.",
    "no board answers": "Look at the board's cable and supply; it is found again by itself.",
    "the board had left": "Nothing has to be done: it is found again by itself.",
    "have not been homed": "Put the handle into its jig and home the encoders.",
    "contradict each other": "Look at the encoders' couplings, put the handle into its jig and home them.",
    "of no pose": "Look at the encoders' couplings, put the handle into its jig and home them.",
    "where the device file says": "Look at the encoders' couplings and take up the session anew to home them.",
    "the handle moved faster": "Ask for slower movements.",
    "did not get the currents": "Look at the board, the brakes' supply and the amplifiers.",
    "the brakes let go": "See that the hand is free and well.",
    "brakes off:": "Allow the brakes when its cause is past.",
    "the process that records": "This computer was held up: close other programs.",
    "the disk could not keep up": "Free the disk of other work.",
    "the recording failed": "Make room on the disk or choose another one, and resume the session.",
    "the start was not reached": "Show the way to the start.",
    "the hand force was not finite": "Look at the force sensor's cable.",
    "the control loop cannot be started": "Close this window, start again and resume the session.",
    "the control loop": "Nothing has to be done: it is started again.",
}


def remedy(cause: str) -> str:
    """What to do about a cause, one sentence; "" where the experimenter gave it."""
    small = cause.lower()
    return next((what for part, what in REMEDIES.items() if part.lower() in small), "")


def with_advice(name: str, reason: str) -> str:
    """What the experimenter reads of a trial (or, without a name, of the bench) and a reason ("": there is none)."""
    if not reason:
        return ""
    what = f"{name}: {reason}" if name else f"{reason[0].upper()}{reason[1:]}"
    return f"{what}. {remedy(reason)}".strip()
