"""The commands of waam_msgs/srv/Command, one function each. Pure; the reply is called once, possibly much later."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from waam_process.names import CONTROLLER_STATES
from waam_process.units import to_mm, to_mm_min

from . import frames, requests
from .core import Bridge
from .gantry import NAMES, STEPS
from .pending import Reply
from .program import number
from .standoff import OF_SOURCE

(
    ARM,
    DISARM,
    HOME,
    JOG,
    JOG_WIRE,
    HOLD,
    RESUME,
    STOP,
    RESET,
    SET_ZERO,
    UNLOCK_ESTOP,
    CLEAR_QUEUE,
    CONFIGURE,
    SETTINGS,
) = range(1, 15)  # waam_msgs/srv/Command
WIRE_JOG_SPEED = 2 / 60  # m/s
REAL_TIME = {STOP: frames.STOP_NOW, HOLD: frames.HOLD_NOW}  # bytes that act before their command


@dataclass(frozen=True)
class Command:
    """Arguments as in waam_msgs/srv/Command; SI."""

    code: int
    text: str = ''
    names: tuple[str, ...] = ()
    vector: tuple[float, float, float] = (0.0, 0.0, 0.0)
    value: float = 0.0


class CommandError(ValueError):
    """A command that is refused before it reaches the controller."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code


def run(bridge: Bridge, command: Command, reply: Reply, now: float) -> None:
    """Starts a command. Errors, too, go to the reply."""
    try:
        name, act = _COMMANDS.get(command.code, ('', None))
        if act is None:
            raise CommandError(requests.BAD_ARGUMENT, f'unknown command {command.code}')
        if not all(math.isfinite(v) for v in (*command.vector, command.value)):
            raise CommandError(
                requests.BAD_ARGUMENT,
                f'{name}: vector {command.vector}, value {command.value}: not finite',
            )
        if not bridge.connected and command.code != STOP:
            raise CommandError(requests.NOT_CONNECTED, bridge.message)
        act(bridge, command, reply, now)
    except CommandError as e:
        reply(e.code, str(e))
    except frames.FrameError as e:
        reply(requests.BAD_ARGUMENT, str(e))


def _need_rest(bridge: Bridge, what: str) -> None:
    """Raises unless no segment waits."""
    if bridge.queued:
        text = f"{what}: job '{bridge.modal.job}' still has {bridge.queued} segments"
        raise CommandError(requests.WRONG_STATE, text)


def _arm(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    if not c.text:
        raise CommandError(requests.BAD_ARGUMENT, 'ARM needs the job id in text')
    if len(c.text) > 100:
        raise CommandError(
            requests.BAD_ARGUMENT, f'a job id of {len(c.text)} characters, at most 100'
        )
    if bridge.modal.job != c.text:
        _need_rest(bridge, 'ARM')
    if problem := bridge.standoff.problem or bridge.gantry.problem:
        raise CommandError(requests.WRONG_STATE, f'ARM: {problem}')
    if unfit := bridge.unfit():
        raise CommandError(requests.WRONG_STATE, f'ARM: {unfit}')
    another = bridge.armed_job != c.text
    if twice := bridge.arming.twice(c.names, now, afresh=another):
        raise CommandError(requests.WRONG_STATE, f'ARM: {twice}')
    bridge.ask('A', c.text, reply, now, lambda: bridge.armed(c.text, list(c.names), now))


def _disarm(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    bridge.ask('D', '', reply, now, bridge.disarm)


def _home(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    _need_rest(bridge, 'HOME')
    if bridge.gantry.problem:
        raise CommandError(requests.WRONG_STATE, f'HOME: {bridge.gantry.problem}')
    if bridge.state != frames.IDLE or bridge.link.sender.pending:
        state = CONTROLLER_STATES[bridge.state]
        raise CommandError(requests.WRONG_STATE, f'HOME: the controller is in {state}, not IDLE')
    bridge.home(reply, now)


def _feed(name: str, value: float) -> str:
    if not value > 0:
        raise CommandError(requests.BAD_ARGUMENT, f'{name}: speed is {value} m/s, must be above 0')
    return number(to_mm_min(value), 2)


def _jog(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    _need_rest(bridge, 'JOG')
    if c.value > bridge.params.speed_max:
        text = f'JOG: speed is {c.value:g} m/s, limit {bridge.params.speed_max:g} m/s'
        raise CommandError(requests.BAD_ARGUMENT, text)
    move = ' '.join(number(to_mm(v), 4) for v in c.vector)
    bridge.ask('J', f'{move} {_feed("JOG", c.value)}', reply, now, bridge.reopen)


def _jog_wire(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    feed = _feed('JOG_WIRE', WIRE_JOG_SPEED)
    bridge.ask('W', f'{number(to_mm(c.value), 3)} {feed}', reply, now)


def _hold(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    bridge.link.out.append(frames.HOLD_NOW)
    bridge.ask('P', '', reply, now)


def _resume(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    if bridge.state != frames.HOLD:
        state = CONTROLLER_STATES[bridge.state]
        raise CommandError(requests.WRONG_STATE, f'RESUME: the controller is in {state}, not HOLD')
    bridge.ask('R', '', reply, now, lambda: bridge.say('resumed'))


def _stop(
    bridge: Bridge, c: Command, reply: Reply, now: float, reason: str = 'stopped by host'
) -> None:
    """The real-time byte acts even when the line is lost; the line brings the answer."""
    bridge.link.sender.blocked = True
    bridge.link.out.append(frames.STOP_NOW)
    if not bridge.connected:
        raise CommandError(
            requests.NOT_CONNECTED, f'{bridge.message}; the stop byte was sent if the port is open'
        )

    def done(code: int, text: str) -> None:
        if code != requests.OK:  # what was not sent yet must not be sent any more
            bridge.stopped(reason)
        reply(code, text)

    bridge.ask('S', '', done, now, lambda: bridge.stopped(reason))


def _reset(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    bridge.ask('X', '', reply, now, lambda: bridge.stopped('reset'))


def _set_zero(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    _need_rest(bridge, 'SET_ZERO')
    if c.value not in (0.0, 1.0):
        raise CommandError(requests.BAD_ARGUMENT, f'SET_ZERO: value is {c.value:g}, must be 0 or 1')
    zero = c.vector
    if c.value == 1.0:
        here = bridge.position
        if bridge.offset is None or here is None:
            raise CommandError(
                requests.WRONG_STATE, 'SET_ZERO: the machine position is not known, give the vector'
            )
        (x0, y0, z0), (x, y, z) = bridge.offset, here
        zero = (x0 + x, y0 + y, z0 + z)
    args = [number(to_mm(v), 4) for v in zero]
    bridge.ask('Z', ' '.join(args), reply, now, lambda: bridge.set_offset(tuple(map(float, args))))


def _unlock_estop(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    if bridge.fault != 300:
        raise CommandError(requests.WRONG_STATE, 'UNLOCK_ESTOP: there is no emergency stop')
    _reset(bridge, c, reply, now)


def _clear_queue(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    if c.text and c.text != bridge.modal.job:
        text = f"CLEAR_QUEUE: the queue belongs to job '{bridge.modal.job}', not '{c.text}'"
        raise CommandError(requests.WRONG_STATE, text)
    if bridge.state == frames.RUN:
        raise CommandError(
            requests.WRONG_STATE, 'CLEAR_QUEUE: the machine runs; hold or stop first'
        )
    _stop(bridge, c, reply, now, 'queue cleared by host')


SETTING = re.compile('[a-z][a-z0-9_]{0,31}')
STANDOFF_NAMES = {name for values in OF_SOURCE.values() for name in values} | {
    'source', 'law', 'up_mm', 'down_mm', 'rate_mm_s', 'cross_mm', 'arc_wander_mm',
}  # fmt: skip


def _configure(bridge: Bridge, c: Command, reply: Reply, now: float) -> None:
    if not SETTING.fullmatch(c.text):
        raise CommandError(requests.BAD_ARGUMENT, f"CONFIGURE: '{c.text}' is no name of a setting")
    if c.text in STANDOFF_NAMES:
        text = f"CONFIGURE: '{c.text}' belongs to the standoff control: set the parameters standoff_* of the bridge"
        raise CommandError(requests.BAD_ARGUMENT, text)
    if c.text.startswith('temperature_'):
        text = f"CONFIGURE: '{c.text}': set the parameters temperature_* of the bridge"
        raise CommandError(requests.BAD_ARGUMENT, text)
    if c.text in NAMES and not c.text.startswith(STEPS):
        text = f"CONFIGURE: '{c.text}' belongs to the gantry: set the parameter of the bridge"
        raise CommandError(requests.BAD_ARGUMENT, text)
    _need_rest(bridge, 'CONFIGURE')
    bridge.ask('C', f'{c.text} {number(c.value, 5)}', reply, now)


def _settings(bridge: Bridge, _: Command, reply: Reply, now: float) -> None:
    _need_rest(bridge, 'SETTINGS')
    bridge.ask('L', '', reply, now)


_COMMANDS = {
    ARM: ('ARM', _arm),
    DISARM: ('DISARM', _disarm),
    HOME: ('HOME', _home),
    JOG: ('JOG', _jog),
    JOG_WIRE: ('JOG_WIRE', _jog_wire),
    HOLD: ('HOLD', _hold),
    RESUME: ('RESUME', _resume),
    STOP: ('STOP', _stop),
    RESET: ('RESET', _reset),
    SET_ZERO: ('SET_ZERO', _set_zero),
    UNLOCK_ESTOP: ('UNLOCK_ESTOP', _unlock_estop),
    CLEAR_QUEUE: ('CLEAR_QUEUE', _clear_queue),
    CONFIGURE: ('CONFIGURE', _configure),
    SETTINGS: ('SETTINGS', _settings),
}
