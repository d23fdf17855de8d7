"""The simulated robot cell for bench_robot.py: speed of the torch, kills. Machine time passes as fast as it can."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_bridge import commands, program
from waam_bridge.frames import ARC_ESTABLISHED, HOMED, IDLE
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
NODE = 'node'
WINDOW = 5  # exchanges of 10 ms


def machine(kind: str, seed: int = 1, params: RobotParams | None = None) -> Machine:
    """A cell with a plate, homed and armed."""
    plant = Plant(part.plate(0.16, 0.13, HEIGHT, 8e-4, 5e-3), seed=seed)
    robot = kind == 'robot'
    made = RobotMachine(params or RobotParams(), plant) if robot else Machine(BridgeParams(), plant)
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


def arm(made: Machine, names: tuple[str, ...] = ()) -> None:
    """The bench may use the arc while `names` answer."""
    _ask(made, commands.Command(commands.ARM, text='bench', names=names))


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


# ---- parts


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


def speed_off(kind: str, points: np.ndarray, seed: int, params: RobotParams | None = None) -> float:
    """How far the true torch speed is off on 99 % of the way that the arc burns."""
    made = machine(kind, seed, params)
    tips: list[np.ndarray] = []

    def see(samples, plant):
        last = samples[-1]
        lit = plant.arc_on
        tips.append(
            np.array([last['table_x'], last['table_y'], last['tool_z'], 1.0 if lit else np.nan])
        )

    arm(made)
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


# ---- kills


@dataclass(frozen=True)
class Kill:
    """what died; off: s until the arc was out."""

    what: str
    off: float


KINDS = ('node', 'bridge', 'driver')


def kill(what: str, after: float, seed: int) -> Kill:
    """Lays a bead, ends `what` `after` s into it, and sees how long the arc burns on."""
    made = machine('robot', seed)
    alive = True

    def beat(frame):
        if alive:
            bridge = made.bridge
            bridge.beat(NODE, frame.t_us, bridge.link.boot, made.now)

    made.on_frame = beat
    arm(made, (NODE,))
    lay(made, _polygon([(15, 65), (145, 65), (145, 66), (15, 66)]))
    if not made.until(lambda: made.bridge.flags & ARC_ESTABLISHED != 0, 60.0):
        raise RuntimeError(f'no arc: {made.bridge.message}')
    made.advance(after)
    if not made.plant.arc_on:
        raise RuntimeError('the arc is out before anything was killed')
    began = made.time_us
    alive = what != 'node'
    made.bridge_dead = what == 'bridge'
    made.robot.dead = what == 'driver'
    out = made.until(lambda: not made.plant.arc_on, 2.0)
    made.close()
    return Kill(what, (made.time_us - began) * 1e-6 if out else 2.0)


# ---- calibrations


def calibrations(numbers: tuple[int, ...]) -> dict[str, np.ndarray]:
    """(seeds, 4): miss of tip or scanner along x, y, z over the half width of its 95 % interval, and its length in m,
    for touches and profiles of simulated robots."""
    from waam_calibrate import robot_evidence, robot_fit
    from waam_lab.robot import references
    from waam_robot.station import Station

    robot, nominal = robot_evidence.Robot(), Station().on_flange(references.NOMINAL)
    out: dict[str, list[list[float]]] = {'touches': [], 'profiles': []}
    for seed in numbers:
        made = references.touches(seed)
        tool = robot_fit.tool(robot_evidence.touches(made.text, robot))
        off = tool.tip - made.truth[:3, 3]
        out['touches'].append([*(off / tool.interval), np.linalg.norm(off)])
        made = references.profiles(seed)
        seen = robot_evidence.profiles(made.text, robot)
        eye = robot_fit.hand_eye(seen, references.RADIUS, nominal)
        off = eye.scanner[:3, 3] - made.truth[:3, 3]
        out['profiles'].append([*(off / eye.interval[:3]), np.linalg.norm(off)])
    return {name: np.array(rows) for name, rows in out.items()}


def longest() -> tuple[float, float, str]:
    """(m at rest, m turning, what was seen): longest boxes over the turn axis, in steps of 0.2 m up to 2.8 m."""
    from waam_robot.station import Place, StationError
    from waam_robot.turn_choice import choose

    best, said = [0.0, 0.0], []
    for length in np.arange(6, 29, 2) / 10:
        high = (float(length), 0.12, 0.1)
        try:
            found = choose(
                Place(origin=(-length / 2, -0.06, 0.0), high=high), np.zeros(3), np.array(high)
            )
        except StationError as e:
            said.append(f'{length:g} m: {e}')
            break
        for n, way in enumerate((found.still, found.way)):
            if way is not None and np.degrees(way.wrist) >= 15.0:
                best[n] = float(length)
        if length in (0.6, 1.2, 1.8):
            said.append(f'{length:g} m: {found.text}')
    return best[0], best[1], '; '.join(said)
