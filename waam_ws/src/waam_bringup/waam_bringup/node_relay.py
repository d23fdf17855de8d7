"""`waam relay`: what a cell tells is published once more on the network of a site, under the name of the cell.

Each cell keeps a ROS domain of its own on its own computer. The relay reads a few topics there and publishes them on
another domain, /cell2/telemetry and so on. It is one-way: it subscribes to nothing on the site's domain and offers no
service, so nobody there can command a cell.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from waam_msgs.msg import Anomaly, JobStatus, LayerReport, MachineState, Telemetry
from waam_node.qos import EVENTS, LATCHED, TELEMETRY

from .cli_common import run_and_domain
from .operate import require_up
from .paths import cell_name

RANGE, PROFILES = 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'FASTRTPS_DEFAULT_PROFILES_FILE'
TOPICS: dict[str, tuple[Any, QoSProfile]] = {
    'machine_state': (MachineState, LATCHED),
    'job_status': (JobStatus, LATCHED),
    'layer_report': (LayerReport, EVENTS),
    'anomaly': (Anomaly, EVENTS),
    'telemetry': (Telemetry, TELEMETRY),
    '/diagnostics': (DiagnosticArray, EVENTS),
}


@contextmanager
def node_on(domain: int, reach: str, name: str, namespace: str = '') -> Iterator[Node]:
    """A node on a domain. reach: LOCALHOST or SUBNET, how far it looks for others."""
    os.environ[RANGE] = reach  # the middleware reads it when a context is made
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node(
        name, context=context, namespace=namespace, start_parameter_services=False, enable_rosout=False,
        use_global_arguments=False, parameter_overrides=[Parameter('start_type_description_service', value=False)],
    )  # fmt: skip
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def connect(cell: Node, site: Node) -> None:
    """Every message of the cell's TOPICS, byte for byte, below the namespace of the site's node."""
    for topic, (kind, qos) in TOPICS.items():
        out = site.create_publisher(kind, topic.lstrip('/'), qos)
        cell.create_subscription(kind, topic, out.publish, qos, raw=True)


def relay(
    name: str, domain: int, site_domain: int, reach: str, ready: Callable[[], None] = lambda: None
) -> None:
    """Until Ctrl-C. name: of the cell, which becomes the namespace. ready: called when both ends are there."""
    os.environ.pop(PROFILES, None)  # that of the graph keeps everything on this computer
    with (
        node_on(domain, 'LOCALHOST', f'relay_{os.getpid()}') as cell,
        node_on(site_domain, reach, 'relay', f'/{name}') as site,
    ):
        connect(cell, site)
        ready()
        executor = SingleThreadedExecutor(context=cell.context)
        executor.add_node(cell)
        try:
            while True:  # with a timeout: Ctrl-C is seen in a cell that tells nothing, too
                executor.spin_once(timeout_sec=0.2)
        finally:
            executor.shutdown()


def run(args: argparse.Namespace) -> int:
    """`waam relay`: until Ctrl-C. ValueError; ClientError when no graph is up."""
    site = args.to_domain
    if not 0 <= site <= 101:
        raise ValueError(f'--to-domain {site}, must be 0 to 101')
    folder, domain = run_and_domain(args)
    if domain == site:
        raise ValueError(
            f'--to-domain {site} is that of the cell itself; cells of one site must not hear one another'
        )
    require_up(folder)
    names = ', '.join(f'/{cell_name()}/{t.lstrip("/")}' for t in TOPICS)
    said = f'ROS_DOMAIN_ID={site} ({args.reach}): {names}; Ctrl-C ends it'
    relay(cell_name(), domain, site, args.reach, lambda: print(said, flush=True))
    return 0
