"""Rules of udev for the serial ports of a cell: a name that stays, rights, no ModemManager, low latency. Pure."""

from __future__ import annotations

from .ports import Port

FILE = '/etc/udev/rules.d/70-waam.rules'
INSTALL = (
    f'waam ports --udev | sudo tee {FILE} && sudo udevadm control --reload && sudo udevadm trigger'
)
# USB vendor and product of a controller's link: our board's own connector (stm32/usb), and UARTs behind ST-Links
BOARD = ('16c0', '27dd', 'waam')  # an ID that many CDC-ACM devices share: so the maker's name, too
ST_LINKS = ('374b', '374e', '374f', '3752', '3753', '3754')
RIGHTS = 'MODE="0660", GROUP="dialout", TAG+="uaccess"'
QUIET = 'ENV{ID_MM_DEVICE_IGNORE}="1", ENV{ID_MM_PORT_IGNORE}="1"'


def rules(controller: Port | None = None) -> str:
    """The file. controller: the one at this port gets the default name of the bridge, whatever adapter it is behind.
    ValueError for a port that cannot be told from others."""
    vendor, product, maker = BOARD
    ours = f'ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}", ATTRS{{manufacturer}}=="{maker}"'
    st = f'ATTRS{{idVendor}}=="0483", ATTRS{{idProduct}}=="{"|".join(ST_LINKS)}"'
    lines = [
        '# Serial ports of a WAAM cell. Written by waam ports --udev; install with',
        f'#   {INSTALL}',
        '# ModemManager opens unknown ports and writes to them; USB may sleep while a weld runs.',
        *_rule('the controller on its own USB connector', ours, 'waam-$env{ID_SERIAL_SHORT}'),
        *_rule('UART of the controller behind an ST-Link', st, 'waam-stlink-$env{ID_SERIAL_SHORT}'),
    ]
    if controller is not None:
        lines += _rule(
            f'the controller at {controller.device} ({controller.text})',
            _of(controller),
            'waam serial/by-id/waam',
        )
    lines += [
        '',
        '# adapters by FTDI hold bytes back for 16 ms',
        'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"',
    ]
    return '\n'.join(lines) + '\n'


def _of(port: Port) -> str:
    if not port.vendor:
        raise ValueError(f'{port.device} is no USB device: it has a name that stays already')
    if not port.serial:
        raise ValueError(
            f'{port.device} ({port.text}) has no serial number: another one of its kind looks the same'
        )
    if any(c in port.serial for c in '"\\\n*?[]|$%'):
        raise ValueError(f'{port.device}: its serial number {port.serial!r} cannot stand in a rule')
    usb = f'ATTRS{{idVendor}}=="{port.vendor:04x}", ATTRS{{idProduct}}=="{port.product:04x}"'
    return f'{usb}, ATTRS{{serial}}=="{port.serial}"'


def _rule(text: str, match: str, link: str) -> list[str]:
    clean = ' '.join(text.split())
    device = match.replace('ATTRS', 'ATTR')
    return [
        '',
        f'# {clean}',
        f'SUBSYSTEM=="tty", {match}, SYMLINK+="{link}", {RIGHTS}, {QUIET}',
        f'ACTION=="add", SUBSYSTEM=="usb", ENV{{DEVTYPE}}=="usb_device", {device}, {QUIET}, '
        'TEST=="power/control", ATTR{power/control}="on"',
    ]
