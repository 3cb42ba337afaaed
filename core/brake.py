"""The MR brake: torque gain and its inverse, time constant, lag, backlash (paper section III-A).

Currents in A, torques in N m, rates in rad/s (Eq. (4) itself is in rpm). Joint index i in the order A, E, B, C.
"""

import math

from core.kernel import kernel

RPM_PER_RAD_S = 60.0 / (2.0 * math.pi)


@kernel
def torque_gain(brakes, i, current):
    """Torque gain K, Eq. (2): steady torque (N m) of brake i at a current (A). At I = 0 it is k_2, the off torque."""
    k = brakes.k
    if current < brakes.knee[i]:
        return k[i, 0] * current + k[i, 1]
    return (k[i, 2] * current + k[i, 3]) * current + k[i, 4]


@kernel
def current_for_torque(brakes, i, torque):
    """Inverse of Eq. (2): the current (A) at which brake i holds `torque` (N m) in steady state.

    Zero below k_2, clipped to [0, current_max], monotone.
    """
    if brakes.present[i] == 0.0:
        return 0.0
    k1, k2, k3, k4, k5 = brakes.k[i, 0], brakes.k[i, 1], brakes.k[i, 2], brakes.k[i, 3], brakes.k[i, 4]
    knee, largest = brakes.knee[i], brakes.current_max[i]
    if torque <= k2:
        return 0.0
    if torque >= torque_gain(brakes, i, largest):
        return largest
    if torque < k1 * knee + k2:
        return min(max((torque - k2) / k1, 0.0), largest)
    # root of k3 I^2 + k4 I + (k5 - torque) on the rising branch, in the form that also stands for k3 -> 0
    c = k5 - torque
    root = math.sqrt(max(k4 * k4 - 4.0 * k3 * c, 0.0))
    current = -2.0 * c / (k4 + root)
    return min(max(current, min(knee, largest)), largest)


@kernel
def time_constant(brakes, i, current, rate, rising):
    """Time constant a, Eq. (4), in s, at a commanded current (A) and a joint rate (rad/s).

    omega_L = log2 of the speed in rpm (our reading: the test grid of 0.5 .. 64 rpm). At omega_0 and above it is a_avg;
    below the floor it is held at its value there (omega -> 0 would diverge).
    """
    table = brakes.rise if rising else brakes.fall
    speed = abs(rate)
    if speed >= brakes.omega_0[i]:
        return table[i, 0]
    w = math.log2(max(speed, brakes.floor[i]) * RPM_PER_RAD_S)
    return (
        table[i, 6]
        + table[i, 2] * w
        + table[i, 4] * w * w
        + current * (table[i, 1] + table[i, 3] * w + table[i, 5] * w * w)
    )


@kernel
def begin_lag(brakes, i, current, gain, torque_yield, rate, acceleration, step, lag):
    """Freeze the lag of Eq. (1) for brake i over the next `step` seconds; fills lag[i] for `lagged_yield`.

    The torque follows K (`gain`) with the time constant a: exact for constant current and speed. Otherwise a is taken
    at the middle of the step with the speed predicted from `rate` and `acceleration`; where the predicted speed crosses
    omega_0 or the floor, the step is split there, each part with its own constant (second order across them).
    Differs from the paper: the lag acts on the yield magnitude, not on the signed torque, which would drive with the
    motion after each reversal. (With `Brakes.signed` the simulator runs the paper's words: see `turn_torques`.)

    lag[i] = (K, y at the start, 1/a first part, time of the split, 1/a second part).
    """
    rising = gain > torque_yield
    start, end = abs(rate), abs(rate + acceleration * step)
    split = step
    for edge in (brakes.omega_0[i], brakes.floor[i]):
        if (start - edge) * (end - edge) < 0.0:
            split = min(split, step * (edge - start) / (end - start))
    lag[i, 0] = gain
    lag[i, 1] = torque_yield
    lag[i, 3] = split
    if split == step:
        lag[i, 2] = lag[i, 4] = inverse(time_constant(brakes, i, current, 0.5 * (start + end), rising))
        return
    share = 0.5 * split / step
    lag[i, 2] = inverse(time_constant(brakes, i, current, start + (end - start) * share, rising))
    lag[i, 4] = inverse(time_constant(brakes, i, current, start + (end - start) * (share + 0.5), rising))


@kernel
def inverse(seconds):
    """1/a; infinite for a brake without lag, a <= 0."""
    return 1.0 / seconds if seconds > 0.0 else math.inf


@kernel
def lagged_yield(lag, i, elapsed):
    """Yield torque (N m) `elapsed` seconds after `begin_lag`, Eq. (1): y = K + (y_0 - K) exp(-t / a). a = 0: y = K."""
    if elapsed <= 0.0:
        return lag[i, 1]
    if elapsed <= lag[i, 3]:
        exponent = elapsed * lag[i, 2]
    else:
        exponent = lag[i, 3] * lag[i, 2] + (elapsed - lag[i, 3]) * lag[i, 4]
    return lag[i, 0] + (lag[i, 1] - lag[i, 0]) * math.exp(-exponent)
