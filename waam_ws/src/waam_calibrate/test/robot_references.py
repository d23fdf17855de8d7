"""Evidence for calibrations from a simulated robot: touches of a fixed point, and profiles of a sphere.

The robot is one of `waam_sim.robot` with its offsets, waves, lengths and backlash. Its tool and its scanner are mounted
a little beside where the programs have them; that is what a calibration has to find.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_robot.arm import AXES
from waam_robot.frames import inverse
from waam_robot.inverse import nearest_turns, solve
from waam_robot.station import Station
from waam_robot.uncertain import turns
from waam_sim.robot import RobotParams, SimRobot

SPIKE = np.array([0.2, 0.15, 0.05])  # m, machine coordinates: the point that is touched
BALL = np.array([0.22, 0.14, 0.03])  # m, machine coordinates: centre of the sphere
RADIUS = 15e-3  # m
TOUCH = 1e-4  # m, of a touch by eye
LEAN, SPIN = np.radians(30.0), np.radians(50.0)  # of the torch
MOUNTED = 2e-3, np.radians(1.0)  # m, rad: standard deviations of how tool and scanner are mounted
NOISE, OUTLIERS, WRONG = 3e-5, 0.002, 1.5e-3  # m, share, m: as of ScannerParams
JOINT_RESOLUTION_DEG = 1e-3  # deg: joints are told so finely
ARC = 0.75  # of the radius of its circle that a profile shows to both sides
MIN_PROFILE_POINTS = 25  # points of a profile beside the sphere's middle
PITCH = 4e-4  # m between points
NOMINAL = np.array(  # scanner on the torch, as of waam_sim.scanner: x_s along y of the machine
    [[0.0, -1.0, 0.0, 0.060], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.120], [0.0, 0.0, 0.0, 1.0]]
)
AIM = (
    (-0.014, -0.010, -0.165),
    (0.014, 0.010, -0.115),
)  # m, centre of the sphere as the scanner sees it


@dataclass(frozen=True)
class Made:
    """text: what `waam calibrate` reads; truth: (4, 4), tool or scanner in the frame of the flange."""

    text: str
    truth: np.ndarray


def touches(seed: int, count: int = 10, params: RobotParams | None = None) -> Made:
    """The wire tip touches the same point in `count` poses."""
    station, robot, rng = _robot(seed, params)
    tool = _mounted(station.place.arm.tool, rng)
    base = station.poses(SPIKE[None])[0]
    lines = ['j1,j2,j3,j4,j5,j6']
    for _ in range(count):
        wanted = base.copy()
        wanted[:3, :3] = wanted[:3, :3] @ _leaning(rng)
        lines.append(_line(_jogged(station, robot, tool, wanted, TOUCH, rng)))
    return Made('\n'.join(lines), tool)


def profiles(seed: int, count: int = 14, params: RobotParams | None = None) -> Made:
    """A sphere seen in `count` poses."""
    station, robot, rng = _robot(seed, params)
    nominal = station.on_flange(NOMINAL)
    scanner = _mounted(nominal, rng)
    centre = (station.poses(BALL[None])[0])[:3, 3]
    lines = ['pose,j1,j2,j3,j4,j5,j6,x_s,z_s']
    upright = (station.poses(BALL[None])[0] @ inverse(station.place.arm.tool) @ nominal)[:3, :3]
    n = 0
    while n < count:
        seen = np.eye(4)
        seen[:3, :3] = upright @ _leaning(rng)
        aim = rng.uniform(*AIM)
        seen[:3, 3] = centre - seen[:3, :3] @ aim
        joints = _jogged(station, robot, nominal, seen, 5e-4, rng)
        points = _profile(_flange(robot, joints, rng) @ scanner, centre, rng)
        if len(points) < MIN_PROFILE_POINTS:  # seen at once by the operator: another pose
            continue
        n += 1
        lines += [f'{n},{_line(joints)},{1e3 * x:.4f},{1e3 * z:.4f}' for x, z in points]
    return Made('\n'.join(lines), scanner)


def _robot(seed: int, params: RobotParams | None) -> tuple[Station, SimRobot, np.random.Generator]:
    station = Station()
    start = np.array([0.06, 0.05, 0.15])
    robot = SimRobot(station, params or RobotParams(), seed, start, start, 0)
    return station, robot, np.random.default_rng([seed, 18])


def _mounted(nominal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    out = nominal.copy()
    out[:3, 3] += rng.normal(0, MOUNTED[0], 3)
    out[:3, :3] = turns(rng.normal(0, MOUNTED[1], 3)) @ out[:3, :3]
    return out


def _leaning(rng: np.random.Generator) -> np.ndarray:
    """(3, 3): leaning by up to LEAN to any side, spun by up to SPIN."""
    side, lean = rng.uniform(0, 2 * np.pi), LEAN * np.sqrt(rng.uniform(0.1, 1.0))
    leant = turns(lean * np.array([np.cos(side), np.sin(side), 0.0]))
    return np.asarray(leant @ turns(np.array([0.0, 0.0, rng.uniform(-SPIN, SPIN)])))


def _jogged(
    station: Station,
    robot: SimRobot,
    tool: np.ndarray,
    wanted: np.ndarray,
    apart: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """(6,) rad, as the drives tell them: the tool (4, 4) is truly at the wanted place (4, 4), `apart` (m) beside it."""
    arm = station.place.arm
    goal, place = wanted.copy(), wanted[:3, 3] + rng.normal(0, apart, 3)
    goal[:3, 3] = place
    joints = station.joints(SPIKE[None])[0]
    for _ in range(4):
        found = solve(arm, (goal @ inverse(tool) @ arm.tool)[None])
        theta = nearest_turns(arm, found.theta[:, station.branch], joints[:AXES])[0]
        if np.isnan(theta).any():
            raise ValueError('a pose of the rehearsal is out of reach')
        goal[:3, 3] += place - (robot.flange(theta) @ tool)[:3, 3]
    return np.radians(np.round(np.degrees(theta) / JOINT_RESOLUTION_DEG) * JOINT_RESOLUTION_DEG)


def _flange(robot: SimRobot, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(4, 4): where the flange truly is, the gears anywhere in their backlash."""
    half = robot.params.backlash / 2
    return robot.flange(theta + rng.uniform(-half, half, AXES))


def _profile(frame: np.ndarray, centre: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n, 2) m, x_s and z_s: the plane y = 0 of the scanner's frame (4, 4) through the sphere."""
    q = (inverse(frame) @ np.append(centre, 1.0))[:3]
    circle = np.sqrt(max(RADIUS**2 - q[1] ** 2, 0.0))
    x = np.arange(-ARC * circle, ARC * circle, PITCH)
    z = q[2] + np.sqrt(circle**2 - x**2) + rng.normal(0, NOISE, len(x))
    z += (rng.uniform(size=len(x)) < OUTLIERS) * rng.normal(0, WRONG, len(x))
    return np.column_stack([q[0] + x, z])


def _line(joints: np.ndarray) -> str:
    return ','.join(f'{np.degrees(v):.3f}' for v in joints)
