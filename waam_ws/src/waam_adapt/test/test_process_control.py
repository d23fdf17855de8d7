"""The process control: PID in velocity form, pulses of a handwheel, what is held and when it is frozen."""

import math

import numpy as np
import pytest

from waam_adapt.process_control.control import Factors, ProcessControl, Sample, exponent
from waam_adapt.process_control.params import ProcessControlParams, reference
from waam_adapt.process_control.pid import Gains, VelocityPid
from waam_node.params import ParameterError
from waam_process import materials

STEEL = materials.get('er70s-6')


def test_velocity_form_is_that_of_the_source():
    """q0 = Kp + Ki Ts + Kd/Ts, q1 = -(Kp + 2 Kd/Ts), q2 = Kd/Ts."""
    kp, ki, kd, dt = 0.4, 2.0, 0.01, 0.04
    pid = VelocityPid(Gains(kp, ki, kd))
    errors = np.random.default_rng(101).normal(0, 0.01, 50)
    pid.step(errors[0], dt, 0.1, 10)
    pid.step(errors[1], dt, 0.1, 10)
    for k in range(2, 50):
        before = pid.output
        q0, q1, q2 = kp + ki * dt + kd / dt, -(kp + 2 * kd / dt), kd / dt
        wanted = before + q0 * errors[k] + q1 * errors[k - 1] + q2 * errors[k - 2]
        if k > 2:  # the first step has no error before it
            assert pid.step(errors[k], dt, 0.1, 10) == pytest.approx(wanted, abs=1e-12)
        else:
            pid.step(errors[k], dt, 0.1, 10)


@pytest.mark.parametrize(('sign', 'limit'), [(1, 1.2), (-1, 0.8)])
def test_at_a_limit_nothing_winds_up(sign, limit):
    """After a long time at the limit the output leaves it with the first error of the other sign."""
    pid = VelocityPid(Gains(0.0, 2.0, 0.0))
    for _ in range(1000):
        pid.step(0.2 * sign, 0.04, 0.8, 1.2)
    assert pid.output == limit
    assert sign * (limit - pid.step(-0.01 * sign, 0.04, 0.8, 1.2)) > 0


def test_a_freeze_leaves_the_output_and_no_kick():
    pid = VelocityPid(Gains(1.0, 0.0, 0.0))
    pid.step(0.0, 0.04, 0.5, 1.5)
    pid.step(0.1, 0.04, 0.5, 1.5)
    before = pid.output
    pid.freeze()
    assert pid.step(-0.3, 0.04, 0.5, 1.5) == before


# ---- the control


class Plant:
    """A cell for the control: current = disturbance * table's current of the wire that comes 60 ms later."""

    def __init__(self, **params) -> None:
        self.control = ProcessControl(ProcessControlParams(**{'value': 'current', **params}))
        self.t, self.disturbance, self.arc = 10.0, 1.0, True
        self.feed, self.speed = 0.1, 0.010  # of the segment
        self.operator = (1.0, 1.0)
        self.sent = [(1.0, 1.0)] * 6  # factors under way
        self.current = 0.0
        self.answers = 0

    def run(self, seconds: float) -> 'Plant':
        for _ in range(round(seconds * 100)):
            self.step()
        return self

    def step(self) -> None:
        self.t += 0.01
        own_speed, own_wire = self.sent.pop(0)
        speed, wire = own_speed * self.operator[0], own_wire * self.operator[1]
        self.current = self.disturbance * STEEL.set_current(self.feed * wire) if self.arc else 0.0
        found = self.control.add(
            Sample(
                self.t, self.current, 22.0, self.speed * speed, self.feed * wire, self.arc, speed, wire,
            )
        )  # fmt: skip
        self.answers += found is not None
        self.sent.append(found if found is not None else self.sent[-1])

    def operate(self, speed: float, wire: float) -> None:
        self.operator = (speed, wire)
        self.control.on_operator(speed, wire)


def test_it_answers_at_least_20_times_a_second():
    plant = Plant()
    plant.run(10.0)
    assert plant.answers >= 200


def test_current_is_held_against_a_disturbance():
    plant = Plant().run(2.0)
    plant.disturbance = 0.95
    plant.run(10.0)
    assert plant.current == pytest.approx(STEEL.set_current(plant.feed), rel=0.007)
    assert plant.control.factors.wire == pytest.approx(0.95 ** (-1 / 0.65), rel=0.012)
    assert plant.control.factors.speed == plant.control.factors.wire  # the metal per length stays


@pytest.mark.parametrize(('keep', 'wire'), [(True, True), (False, False)])
def test_heat_input_is_held_by_the_speed(keep, wire):
    plant = Plant(value='heat_input', keep_metal=keep).run(2.0)
    plant.disturbance = 1.03
    plant.run(10.0)
    f = plant.control.factors
    heat = plant.current * 22.0 / (plant.speed * f.speed)
    assert heat == pytest.approx(STEEL.set_current(plant.feed) * 22.0 / plant.speed, rel=1e-3)
    assert (f.wire != 1.0) == wire and f.speed > 1.0


def test_what_segments_and_operator_want_is_no_error():
    """A correction changes feed and speed, the operator multiplies both: the control leaves them alone."""
    plant = Plant().run(3.0)
    plant.feed, plant.speed = 0.08, 0.012
    plant.run(3.0)
    plant.operate(0.9, 1.1)
    plant.run(3.0)
    assert plant.control.factors == pytest.approx((1.0, 1.0), abs=2e-3)
    assert plant.control.status.reference == pytest.approx(STEEL.set_current(0.088), rel=5e-3)


def test_a_chosen_value_scales_with_the_segments():
    chosen = 0.9 * STEEL.set_current(STEEL.wire_feed)
    plant = Plant(setpoint=chosen).run(8.0)
    assert plant.current == pytest.approx(0.9 * STEEL.set_current(plant.feed), rel=2e-3)


def test_limits_hold_and_are_told():
    plant = Plant().run(2.0)
    plant.disturbance = 0.5
    plant.run(10.0)
    assert plant.control.factors.wire == pytest.approx(1.25) and plant.control.status.limited
    plant.disturbance = 1.0
    plant.run(3.0)
    assert not plant.control.status.limited


def test_the_product_with_the_operators_factor_stays_in_its_range():
    plant = Plant().run(2.0)
    plant.operate(1.0, 1.45)
    plant.disturbance = 0.7
    plant.run(10.0)
    assert 1.45 * plant.control.factors.wire <= 1.5 + 1e-9


@pytest.mark.parametrize('why', ['no arc', 'just started', 'stands', 'speed changes'])
def test_frozen_at_arc_start_and_end_and_in_corners(why):
    plant = Plant().run(2.0)
    plant.disturbance = 0.95
    plant.run(5.0)
    held = plant.control.law.output
    plant.disturbance = 0.8
    if why == 'no arc':
        plant.arc = False
        plant.run(1.0)
        assert plant.control.factors == Factors()  # idle moves have the operator's speed
    elif why == 'just started':
        plant.arc = False
        plant.run(0.5)
        plant.arc = True
        plant.run(0.45)
    elif why == 'stands':
        plant.speed = 0.0
        plant.run(2.0)
    else:
        for _ in range(20):
            plant.speed *= 1.2 if plant.speed < 0.01 else 0.8
            plant.run(0.05)
    assert plant.control.law.output == pytest.approx(held, abs=0.003)
    assert why in plant.control.status.reason


def test_frozen_when_telemetry_is_stale():
    plant = Plant().run(2.0)
    plant.disturbance = 0.95
    plant.run(5.0)
    held = plant.control.factors
    plant.control.freeze('telemetry is stale')
    assert plant.control.factors == held
    plant.t += 5.0  # and then it comes again
    plant.run(0.3)
    assert plant.control.factors.wire == pytest.approx(held.wire, abs=1e-6)


def test_a_control_that_starts_late_learns_the_operators_factors():
    plant = Plant()
    plant.operator = (0.8, 1.2)  # said before it was there
    plant.arc = False
    plant.run(1.0)
    plant.arc = True
    plant.run(3.0)
    assert plant.control.operator == (0.8, 1.2)
    assert plant.control.factors == pytest.approx((1.0, 1.0), abs=2e-3)


def test_a_material_without_current_is_refused():
    with pytest.raises(ParameterError, match='er4043'):
        ProcessControlParams(value='current', material='er4043')
    ProcessControlParams(value='none', material='er4043')


def test_exponents_and_values():
    assert exponent('current', True) == exponent('power', False) == 0.65
    assert exponent('heat_input', False) == -1.0 and exponent('heat_input', True) == -0.35
    assert reference('power', 100, 20, 0.01) == 2000
    assert reference('heat_input', 100, 20, 0.01) == 2e5
    assert math.isnan(reference('heat_input', 100, 20, 0.0))
