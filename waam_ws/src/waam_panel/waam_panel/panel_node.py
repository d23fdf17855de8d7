"""Node panel: the operator's web page. Callbacks put messages into a bounded mailbox; a thread of its own serves."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Temperature

from waam_msgs.msg import (
    Anomaly,
    CorrectionMap,
    HeatFactor,
    HeightMap,
    JobStatus,
    LayerPlan,
    LinkStatus,
    MachineState,
    ProcessControl,
    Standoff,
    Telemetry,
)
from waam_node.node import OK, WARN, WaamNode
from waam_node.node import main as run_main
from waam_node.params import param
from waam_node.qos import BEAT, EVENTS, LATCHED, SENSOR, TELEMETRY
from waam_process.materials import load as materials
from waam_shop.notifier import Notifier, load
from waam_shop.notify_settings import NotifyError, NotifySettings
from waam_shop.shop_folder import Shop
from waam_view.mailbox import Mailbox
from waam_view.node_tap import TelemetryTap

from .cell import Cell
from .conversions import CONVERT
from .node_operations import RosOperations
from .operations import Place
from .parts import PartFolders
from .security import Guard, KnownTokens, is_local, open_tokens, tls_context
from .shop_link import ShopLink
from .state import PanelState
from .web import WebServer


@dataclass(frozen=True)
class PanelParams:
    """Parameters of the node, with default, meaning, unit and limits."""

    bind: str = param(
        '127.0.0.1',
        'address to listen on; anything but this machine needs token_file, tls_cert and tls_key',
    )
    port: int = param(8600, 'port of the page; 0 = any free one', '', 0, 65535)
    token_file: str = param('', 'file of tokens (waam token create); empty = nobody signs in')
    tls_cert: str = param('', 'certificate with its chain, PEM; empty = no TLS')
    tls_key: str = param('', 'key of the certificate, PEM, chmod 600')
    shop_dir: str = param(
        '', 'folder of the shop: queues, audit logs, messages; empty = .shop in jobs_dir'
    )
    calibrations_dir: str = param(
        '', 'folder of calibration results that may refuse a job; empty = none are looked at'
    )
    cell: str = param('cell', 'name of this cell in the shop')
    stop_socket: str = param(
        '', 'Unix socket of the bridge for STOP past everything; empty = only by its service'
    )
    stop_port: int = param(
        0, "port of stop_lane, the second way for the page's STOP; 0 = none", '', 0, 65535
    )
    allowed_hosts: str = param(
        '',
        'further names of this machine that the page may be asked for by, separated by commas; with or without port',
    )
    jobs_dir: str = param('jobs', 'folder of the jobs')
    part_folders: tuple = param(('parts',), 'folders with parts; the first one takes uploads')
    run_dir: str = param(
        '', 'folder of the running graph of waam up, for Restart programs; empty = there is none'
    )
    commission: str = param(
        '',
        'words of Python that commission this cell, as a shell reads them; empty = the page Commissioning refuses',
    )
    upload_mb: int = param(64, 'largest part that can be uploaded', 'MB', 1, 1024)
    error_range: float = param(
        0.0006, 'height error at the ends of the colour scale', 'm', 1e-5, 0.1
    )


SAMPLE_S, KEPT_S = (
    0.1,
    180.0,
)  # steady time between two samples of the plots, and how far they reach back
FRAMES = 4  # telemetry frames read per sample period at most
TOPICS = (  # name of the section, type, topic, quality of service, newest only
    ('machine', MachineState, 'machine_state', LATCHED, False),
    ('link', LinkStatus, 'link_status', BEAT, True),
    ('job', JobStatus, 'job_status', LATCHED, False),
    ('heat', HeatFactor, 'heat_factor', LATCHED, True),
    ('temperature', Temperature, 'temperature', SENSOR, True),
    ('plan', LayerPlan, 'layer_plan', LATCHED, True),
    ('standoff', Standoff, 'standoff', TELEMETRY, True),
    ('process', ProcessControl, 'process_control', TELEMETRY, True),
    ('height', HeightMap, 'height_map', LATCHED, True),
    ('correction', CorrectionMap, 'correction_map', LATCHED, True),
    ('anomaly', Anomaly, 'anomaly', EVENTS, False),
    ('diagnostics', DiagnosticArray, '/diagnostics', EVENTS, False),
)


class Panel(WaamNode):
    """Not required by the arc lease: its death or silence stops no job."""

    def __init__(self) -> None:
        super().__init__('panel', PanelParams)
        p = self.params
        self._tls = tls_context(p.tls_cert, p.tls_key)
        file = open_tokens(p.token_file, p.bind, self._tls is not None)
        self._tokens = KnownTokens(file) if file else None
        self._shop = Shop(Path(p.shop_dir or Path(p.jobs_dir) / '.shop'))
        self._shop.folder(p.cell)  # refuses a name that is none
        if not p.part_folders:
            raise ValueError("panel: parameter 'part_folders' names no folder")
        self._mailbox = Mailbox()
        self._tap = TelemetryTap(self, '_panel_tap')
        self._operations = RosOperations(self, Path(p.run_dir) if p.run_dir else None)
        for name, kind, topic, qos, newest in TOPICS:
            self.create_subscription(kind, topic, self._put(name, newest), qos)
        self.create_timer(SAMPLE_S, self._on_sample, clock=self.steady)
        self.create_timer(1.0, self._report, clock=self.steady)
        self._cell: Cell | None = None
        self._server = WebServer(self._make_cell, p.bind, p.port, self._tls)
        if self._server.problem:
            self.get_logger().error(f'no page: {self._server.problem}')
        else:
            self.get_logger().info(f'page: {self.url}')

    @property
    def url(self) -> str:
        """Address for a browser on this machine, or on the network of `bind`; '' while the server does not run."""
        return '' if self._server.problem else self._url(self._server.port)

    def _url(self, port: int) -> str:
        p = self.params
        named = p.allowed_hosts.split(',')[0].strip()
        host = '127.0.0.1' if is_local(p.bind) else named or p.bind
        return f'{"https" if self._tls else "http"}://{host.partition(":")[0]}:{port}/'

    def _shop_link(self, port: int) -> ShopLink:
        try:
            settings = load(self._shop.path)
        except NotifyError as e:
            self.get_logger().error(f'nobody is told of anything: {e}')
            settings = NotifySettings()
        domain = self.context.get_domain_id()
        place = Place(self.params.cell, domain, self._url(port))
        return ShopLink(self._shop, place, Notifier(settings, self.params.cell))

    def _make_cell(self, port: int) -> Cell:
        p = self.params
        self._cell = Cell(
            guard=Guard.create(self._tokens, p.bind, port, tuple(p.allowed_hosts.split(','))),
            state=PanelState(round(FRAMES * KEPT_S / SAMPLE_S)),
            operations=self._operations,
            mailbox=self._mailbox,
            convert=lambda name, message: CONVERT[name](message),
            parts=PartFolders(tuple(Path(f) for f in p.part_folders)),
            jobs_dir=Path(p.jobs_dir),
            materials=tuple(materials()),
            error_range=p.error_range,
            upload_bytes=p.upload_mb << 20,
            shop=self._shop_link(port),
            calibrations=Path(p.calibrations_dir) if p.calibrations_dir else None,
            stop_socket=p.stop_socket,
            stop_port=p.stop_port,
            commission=tuple(shlex.split(p.commission)),
        )
        return self._cell

    def _put(self, name: str, newest: bool) -> Any:
        """A callback that only hands over."""
        if name == 'process':
            return self._on_process
        if newest:
            return lambda message: self._mailbox.replace(name, (name, message))
        return lambda message: self._mailbox.put((name, message))

    def _on_process(self, message: ProcessControl) -> None:
        self._operations.order.process(message)
        self._mailbox.replace('process', ('process', message))

    def _on_sample(self) -> None:
        """Decodes a few of the frames since the last time; simulated time can run fast."""
        frames = self._tap.take()
        step = -(-len(frames) // FRAMES)
        for raw in frames[-1::-step][::-1] if frames else ():
            message = deserialize_message(raw, Telemetry)
            self._operations.order.telemetry(message)
            self._mailbox.put(('telemetry', message))

    def _report(self) -> None:
        cell = self._cell
        self.values = {
            'page': self.url, 'pages_open': cell.pages if cell else 0, 'dropped': self._mailbox.dropped,
        }  # fmt: skip
        problem = self._server.problem or (
            cell.background.problem() or cell.problem if cell else ''
        )
        self.level, self.message = (WARN, problem) if problem else (OK, 'ok')

    def close(self) -> None:
        """Stops the server first, then what it asks."""
        self._server.close()
        self._operations.close()
        self._tap.close()


def main() -> None:
    run_main(Panel)
