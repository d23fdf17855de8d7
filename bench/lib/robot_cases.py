"""What bench_robot.py measures: Pinocchio's iterative inverse, the tables of the source, the oval."""

from __future__ import annotations

import time

import numpy as np

from waam_robot.arm import M20IB25, Arm, forward, link_frames
from waam_robot.frames import pose_from_wpr, rotation
from waam_robot.inverse import BRANCHES, solve
from waam_robot.positioner import Positioner
from waam_robot.split import split

FORWARD = [
    ((0, 0, 0, 0, 0, 0), (1100, 0, -315), (1390, 0, -405)),
    ((0, 90, 0, 0, 0, 0), (1040, 0, 1675), (1130, 0, 1965)),
    ((30, 60, -20, 40, 50, 60), (1117.291, 588.210, 836.739), (1211.277, 299.969, 853.587)),
]
TABLE_3_4 = [(0, (75, 0, 0)), (45, (53.033, 53.033, 0)), (90, (0, 75, 0))]
TABLE_2_2 = np.array(
    [
        (100.358, -4.530, 0.003, 19.953, 0.956, -89.576, 19.975, 267.416),
        (99.804, 5.455, 0.003, 19.698, 3.380, -96.297, 19.975, 273.129),
        (99.626, 8.660, 0.003, 19.368, 5.090, -98.056, 20.001, 274.968),
        (99.012, 14.024, 0.003, 18.829, 6.873, -100.186, 20.001, 278.062),
        (98.131, 19.245, 0.003, 18.215, 8.399, -101.765, 19.998, 281.096),
    ]
)
OVAL, OVALITY = 0.5, 0.05  # m, share
CELL = Positioner(a_b=1.1, d_b=0.3, d_c=0.1)


def analytic(poses: int, seed: int = 1) -> tuple[float, float]:
    """Largest deviation of a wire-tip pose over all branches (m, and of its unit axes), us per pose: best of three."""
    theta = np.random.default_rng(seed).uniform(-np.pi, np.pi, (poses, 6))
    wanted = forward(M20IB25, theta)
    taken = []
    for _ in range(3):
        begin = time.perf_counter()
        found = solve(M20IB25, wanted)
        taken.append((time.perf_counter() - begin) / poses * 1e6)
    worst = 0.0
    for branch in range(BRANCHES):
        there = found.reachable[:, branch]
        off = forward(M20IB25, found.theta[there, branch]) - wanted[there]
        worst = max(worst, float(np.abs(off).max()))
    if not found.any.all():
        raise SystemExit('robot.ik_error_m: a pose that the arm was in is told out of reach')
    return worst, min(taken)


def iterative(poses: int, seed: int = 1) -> tuple[float, float]:
    """us per pose and share solved: Pinocchio's damped least squares (its documented example, in Python), one solution
    per pose, from a start 0.3 rad off it, to 1e-9. ImportError without pin."""
    import pinocchio as pin

    model = _model(pin, M20IB25)
    data = model.createData()
    rng = np.random.default_rng(seed)
    theta = rng.uniform(-np.pi, np.pi, (poses, 6))
    starts = theta + rng.uniform(-0.3, 0.3, (poses, 6))
    wanted = [pin.SE3(p) for p in forward(M20IB25, theta, tool=False)]
    solved = 0
    begin = time.perf_counter()
    for start, goal in zip(starts, wanted, strict=True):
        solved += _clik(pin, model, data, start.copy(), goal)
    return (time.perf_counter() - begin) / poses * 1e6, solved / poses


def _clik(pin, model, data, q: np.ndarray, goal) -> bool:
    """Damped least squares, full steps."""
    for _ in range(100):
        pin.forwardKinematics(model, data, q)
        off = data.oMi[6].actInv(goal)
        error = pin.log(off).vector
        if np.linalg.norm(error) < 1e-9:
            return True
        j = -pin.Jlog6(off.inverse()) @ pin.computeJointJacobian(model, data, q, 6)
        v = -j.T @ np.linalg.solve(j @ j.T + 1e-12 * np.eye(6), error)
        q = pin.integrate(model, q, v)
    return False


def _model(pin, arm: Arm):
    """The arm of a DH table: joints turn about z, the rest of a row is the place of the next joint."""
    model, place = pin.Model(), np.eye(4)
    for n, link in enumerate(arm.links):
        model.addJoint(n, pin.JointModelRZ(), pin.SE3(place), f'joint{n + 1}')
        place = rotation(0, link.alpha)
        place[:3, 3] = link.a, 0.0, link.d
    # the frame behind joint 6 (d6) is put into the goal
    tail = np.eye(4)
    tail[2, 3] = arm.links[5].d
    model.jointPlacements[6] = model.jointPlacements[6] * pin.SE3(tail)
    return model


def table_errors() -> dict[str, float]:
    """Largest deviations from the printed values: forward (mm), table 3.4 (mm), table 2.2 (deg)."""
    ahead = [
        np.abs(forward(M20IB25, np.radians(q), tool=tool)[:3, 3] * 1e3 - wanted).max()
        for q, *both in FORWARD
        for tool, wanted in zip((False, True), both, strict=True)
    ]
    first = []
    for degrees, end in TABLE_3_4:
        tip = link_frames(M20IB25, np.radians([degrees, 0, 0, 0, 0, 0]))[1, :3, 3] * 1e3
        first.append(np.abs(tip - [0, 0, 650] - end).max())
    found = split(pose_from_wpr(TABLE_2_2[:, :3] * 1e-3, np.radians(TABLE_2_2[:, 3:6])))
    off = [np.degrees(found.b) + TABLE_2_2[:, 6], np.degrees(found.c) - TABLE_2_2[:, 7]]
    return {
        'forward_mm': float(max(ahead)),
        'table_3_4_mm': float(max(first)),
        'table_2_2_deg': float(np.abs(off).max()),
    }
