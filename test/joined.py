"""Moves by the general harmonic law (S4, given ends) at the steps of the motors: the controller core drives them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_plan.harmonic import JoiningLaw

RUN_UP, AFTER = 0.02, 0.02  # m at one speed, before and behind the laws
SPEED = 0.01  # m/s, before them
JOINT = (0.018, 0.08)  # m, m/s^2: place and acceleration where the two laws meet
END = 0.08  # m; no acceleration there
TIMES = (0.8, 1.0)  # s
SMOOTHED = 20  # ms


def laws() -> tuple[JoiningLaw, JoiningLaw]:
    """Two laws that join in place, speed and acceleration; places count from the end of the run-up."""
    first = JoiningLaw.joining((0.0, SPEED, 0.0), JOINT, TIMES[0])
    speed = float(first.speed(TIMES[0]))
    return first, JoiningLaw.joining((JOINT[0], speed, JOINT[1]), (END, 0.0), TIMES[1])


@dataclass
class Driven:
    """place (n,): m along the way, one per ms."""

    place: np.ndarray

    def speed_error(self) -> float:
        """Greatest difference from the speed of the laws, over their greatest one; where the laws were, in place."""
        first, second = laws()
        t = [np.linspace(0, d, 4000) for d in TIMES]
        at = np.concatenate([first.position(t[0]), second.position(t[1])])
        wanted = np.concatenate([first.speed(t[0]), second.speed(t[1])])
        window = np.ones(SMOOTHED) / SMOOTHED
        speed = np.convolve(np.diff(self.place) / 1e-3, window, mode='valid')
        place = np.convolve(self.place[1:], window, mode='valid')
        inside = (place > 1e-3) & (place < END - 1e-3)
        off = speed[inside] - np.interp(place[inside], at, wanted)
        return float(np.abs(off).max() / wanted.max())


def drive(shaker, how: str, point: tuple[float, float, float]) -> Driven:
    """Along x. how: 'law', or 'plain' = one speed, the mean, for each of the two parts."""
    x, y, z = point[0] - 0.06, point[1], point[2]
    first, second = laws()
    if how == 'law':
        parts = [law.pieces() for law in (first, second)]
    else:
        parts = [
            (np.array([0.0, JOINT[0]]), np.array([JOINT[0] / TIMES[0]])),
            (np.array([JOINT[0], END]), np.array([(END - JOINT[0]) / TIMES[1]])),
        ]
    moves = [(0.0, SPEED)]
    for at, speeds in parts:
        moves += zip(at[1:].tolist(), speeds.tolist(), strict=True)
    moves.append((END + AFTER, float(second.speed(TIMES[1]))))
    shaker.go(((x - RUN_UP, y, z), 0.05))
    path: list[np.ndarray] = []
    shaker.machine.on_exchange = lambda samples, plant: path.append(-samples['table_x'])
    shaker.go(*(((x + at, y, z), speed) for at, speed in moves))
    place = np.concatenate(path) - x
    return Driven(place[(place > -0.5 * RUN_UP) & (place < END + 0.5 * AFTER)])
