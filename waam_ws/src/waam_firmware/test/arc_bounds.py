"""What a PI and a PID can reach on the plant k/(T s + 1) with dead time and unknown gain, by search;
many controllers at a time.

    python3 waam_ws/src/waam_firmware/test/arc_bounds.py        prints the figures of doc/arc_regulator.md (a minute)

Independent of the C code: its own discretisation, double precision, no limits of the output.
"""

from __future__ import annotations

import math

import numpy as np

TS, LAG, DELAY = 1e-4, 0.05, 0.01
BAND, REACTED = 0.02, 0.1


def simulate(
    pid: np.ndarray, gain: float, disturbance: bool, seconds: float = 0.35
) -> tuple[np.ndarray, np.ndarray]:
    """pid: (n, 4) kp, ki, kd, filter_s. The error must fall from 1 (step of setpoint or disturbance: the same loop).
    Returns the time (n,) after which it stays within the band and the overshoot (n,), share of the step."""
    kp, ki, kd, tf = pid.T
    n, keep, smooth = len(pid), math.exp(-TS / LAG), TS / (tf + TS)
    line = np.zeros((round(DELAY / TS), n))
    y, u, before, slope = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    last, lowest = np.zeros(n), np.zeros(n)
    band = REACTED if disturbance else BAND
    with np.errstate(over='ignore', invalid='ignore'):
        for k in range(round(seconds / TS)):
            slot = k % len(line)
            y = keep * y + (1 - keep) * gain * line[slot]
            e = 1.0 - y
            new = slope + smooth * (kd * (e - before) / TS - slope)
            u = u + kp * (e - before) + ki * TS * e + new - slope
            before, slope = e, new
            line[slot] = u
            last = np.where(np.abs(e) <= band, last, k + 1)
            lowest = np.minimum(lowest, e)
    return last * TS, np.where(np.isfinite(y), -lowest, np.inf)


def worst(
    pid: np.ndarray, gains: tuple[float, ...], disturbance: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Slowest time and largest overshoot of each controller over the gains."""
    times, over = zip(*(simulate(pid, g, disturbance) for g in gains), strict=True)
    return np.max(times, axis=0), np.max(over, axis=0)


def pi_map(points: int = 60) -> tuple[float, np.ndarray]:
    """All PIs that could matter: best worst settling time at <= 5 % overshoot over +-50 % gain, and its gains."""
    kp, ki = np.meshgrid(np.linspace(0.2, 4.0, points), np.linspace(4.0, 80.0, points))
    pid = np.column_stack([kp.ravel(), ki.ravel(), np.zeros(kp.size), np.full(kp.size, 1e-3)])
    times, over = worst(pid, (0.5, 1.0, 1.5))
    times[over > 0.05] = np.inf
    best = int(times.argmin())
    return float(times[best]), pid[best]


def pid_search(
    gains: tuple[float, ...],
    limit: float,
    disturbance: bool,
    noise_gain: float,
    rounds: int = 10,
    seed: int = 1,
) -> tuple[float, np.ndarray]:
    """Best time found at an overshoot of at most `limit`, of PIDs with kp + kd / filter_s <= noise_gain."""
    rng = np.random.default_rng(seed)
    low, high = np.log([0.2, 2.0, 1e-4, 5e-4]), np.log([20.0, 300.0, 0.1, 0.03])
    centre, width, best, found = (low + high) / 2, (high - low) / 2, math.inf, np.zeros(4)
    for _ in range(rounds):
        pid = np.exp(np.clip(centre + width * rng.uniform(-1, 1, (1500, 4)), low, high))
        pid = pid[pid[:, 0] + pid[:, 2] / pid[:, 3] <= noise_gain]
        if not len(pid):
            continue
        times, over = worst(pid, gains, disturbance)
        times = np.where(over > limit, 1.0 + over, times)
        if times.min() < best:
            best, found = float(times.min()), pid[times.argmin()]
            centre = np.log(found)
        width = width * 0.75
    return best, found


def main() -> None:
    """Prints the bounds."""
    spread = (0.5, 1.0, 1.5)
    time, gains = pi_map(120)
    print(f'PI, +-50 %: settling {time:.4f} s at best, kp {gains[0]:.2f} ki {gains[1]:.1f}')
    for noise in (3.0, 4.0, 8.0, 20.0):
        time, found = pid_search(spread, 0.05, False, noise)
        print(f'PID, +-50 %, noise gain {noise:g}: settling {time:.4f} s', np.round(found, 4))
    for gain in (1.5, 1.0):
        for noise in (8.0, 1000.0):
            time, found = pid_search((gain,), 0.01, True, noise)
            print(
                f'PID, gain {gain} known, noise gain {noise:g}: reaction {time:.4f} s',
                np.round(found, 4),
            )


if __name__ == '__main__':
    main()
