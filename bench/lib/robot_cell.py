"""The simulated robot cell for bench_robot.py: speed of the torch. Machine time passes as fast as it can."""

from __future__ import annotations

import numpy as np

from waam_bridge import commands, program
from waam_bridge.frames import HOMED, IDLE
from waam_bridge.params import BridgeParams
from waam_lab.machine import Machine
from waam_lab.robot.robot_machine import RobotMachine
from waam_process.segment import Kind, Segment
from waam_robot_bridge.params import RobotParams
from waam_sim import part
from waam_sim.plant import Plant

SPEED = 10e-3  # m/s
HEIGHT, ABOVE = 0.010, 0.030  # m: of the plate and of travel
ZERO = (0.100, 0.080, 0.020)  # m, where the plate is clamped
WIRE, VOLTS = 6 / 60, 22.0  # m/s, V
WINDOW = 5  # exchanges of 10 ms


def machine(kind: str, seed: int = 1) -> Machine:
    """A cell with a plate, homed and armed."""
    plant = Plant(part.plate(0.16, 0.13, HEIGHT, 8e-4, 5e-3), seed=seed)
    robot = kind == 'robot'
    made = RobotMachine(RobotParams(), plant) if robot else Machine(BridgeParams(), plant)
    made.connect()
    asked = commands.Command
    for command in (asked(commands.RESET), asked(commands.HOME)):
        _ask(made, command)
    made.until(lambda: bool(made.bridge.flags & HOMED) and made.bridge.state == IDLE, 60.0)
    _ask(made, asked(commands.SET_ZERO, vector=ZERO))
    made.advance(0.5)
    return made


def _ask(made: Machine, command: commands.Command) -> None:
    code, text = made.command(command)
    if code:
        raise RuntimeError(f'command {command.code}: {text}')


def lay(made: Machine, points: np.ndarray) -> None:
    """Queues the way to the first of points (n, 3), m, on the plate, and a bead along them."""
    first = points[0]
    here = np.array(made.bridge.position)
    over = np.array([first[0], first[1], HEIGHT + ABOVE])
    up = np.array([here[0], here[1], max(here[2], HEIGHT + ABOVE)])
    way = [here, up, over, first] if here[2] < HEIGHT + ABOVE else [here, over, first]
    segments = [_segment(i, Kind.IDLE, a, b, 0.05) for i, (a, b) in enumerate(_pairs(way))]
    for a, b in _pairs(points):
        segments.append(_segment(len(segments), Kind.DEPOSIT, a, b, SPEED))
    permit = made.bridge.permit('bench', segments)
    made.bridge.commit(permit, program.prepare(permit, segments, True))


def _pairs(points):
    return [(a, b) for a, b in zip(points, points[1:], strict=False) if np.linalg.norm(b - a) > 0]


def _segment(index: int, kind: Kind, a: np.ndarray, b: np.ndarray, speed: float) -> Segment:
    arc = kind == Kind.DEPOSIT
    source = {'arc': True, 'wire_feed_speed': WIRE, 'voltage': VOLTS} if arc else {}
    start, end = tuple(map(float, a)), tuple(map(float, b))
    return Segment(index, kind, start, end, speed, layer=1, bead=1, **source)


def _closed(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.column_stack([x, y, np.full(len(x), HEIGHT)])


def _polygon(corners: list[tuple[float, float]]) -> np.ndarray:
    return _closed(*(np.array(v, float) * 1e-3 for v in zip(*corners, strict=True)))


def _around(radius_x: float, radius_y: float, turns: float = 1.0, shrink: float = 0.0):
    t = np.linspace(0, 2 * np.pi * turns, int(180 * turns) + 1)
    share = 1 - shrink * t / t[-1]
    return _closed(0.08 + share * radius_x * np.cos(t), 0.065 + share * radius_y * np.sin(t))


PARTS = {
    'line': lambda: _polygon([(15, 20), (145, 95)]),
    'oval': lambda: _around(0.06, 0.05),
    'spiral': lambda: _around(0.055, 0.05, 3.0, 0.7),
    'wave': lambda: _closed(x := np.linspace(0.015, 0.145, 131), 0.065 + 0.02 * np.sin(x / 0.012)),
    'frame': lambda: _polygon([(20, 15), (140, 15), (140, 115), (20, 115), (20, 15)]),
    'pad': lambda: _polygon(
        [(x, 20 + 4.4 * n) for n in range(9) for x in ((20, 120), (120, 20))[n % 2]]
    ),
}


def speed_off(kind: str, points: np.ndarray, seed: int) -> float:
    """How far the true torch speed is off on 99 % of the way that the arc burns."""
    made = machine(kind, seed)
    tips: list[np.ndarray] = []

    def see(samples, plant):
        last, lit = samples[-1], 1.0 if plant.arc_on else np.nan
        tips.append(np.array([last['table_x'], last['table_y'], last['tool_z'], lit]))

    _ask(made, commands.Command(commands.ARM, text='bench'))
    made.on_exchange = see
    lay(made, points)
    made.advance(0.1)
    done = made.until(lambda: made.bridge.state == IDLE and not made.bridge.queued, 300.0)
    made.close()
    if not done:
        raise RuntimeError(f'{kind}: the bead did not end: {made.bridge.message}')
    return _within(np.array(tips))


def _within(tips: np.ndarray) -> float:
    """tips: (n, 4) x, y, z (m) every 10 ms and NaN where no arc burns. The speed is that along the path over 50 ms; the
    gantry moves in steps of 3 um, which would hide it in less."""
    way = np.linalg.norm(np.diff(tips[:, :3], axis=0), axis=1)
    way[np.isnan(tips[1:, 3]) | np.isnan(tips[:-1, 3])] = np.nan
    windows = np.lib.stride_tricks.sliding_window_view(way, WINDOW)
    off = np.abs(windows.mean(axis=1) / 1e-2 / SPEED - 1)
    share = windows[:, WINDOW // 2]
    good = ~np.isnan(off)
    order = np.argsort(off[good])
    passed = np.cumsum(share[good][order])
    return float(off[good][order][np.searchsorted(passed, 0.99 * passed[-1])])
