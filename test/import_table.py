"""The import table: which package may import which, and what a module may do besides computing.

Every module is a core unless this file says otherwise. A core takes numbers and returns numbers: it knows no ROS (not
even through what it imports), no clock, no file, no socket and no other process. Time and data are arguments.

Three ways out, in the order of preference:
* put what talks to the world into a file whose name says so (EDGES);
* name a file whose purpose it is to talk to the world, with the purpose (TALKS_TO_THE_WORLD);
* KNOWN: a violation that somebody is about to mend. It only ever shrinks; a test fails when an entry is stale.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import NamedTuple

from import_graph import Workspace, impurities

MESSAGES = 'waam_msgs'
MAY_IMPORT: dict[str, set[str]] = {
    'waam_process': set(),
    'waam_node': {'waam_process'},
    'waam_bridge': {'waam_node', 'waam_process'},
    'waam_sim': {'waam_node', 'waam_process', 'waam_robot'},
    'waam_record': {'waam_node', 'waam_process'},
    'waam_scan': {'waam_node', 'waam_plan', 'waam_process', 'waam_record'},  # readers of clouds
    'waam_plan': {'waam_process', 'waam_robot'},
    'waam_robot': set(),
    'waam_robot_bridge': {'waam_bridge', 'waam_node', 'waam_process', 'waam_robot'},
    'waam_calibrate': {'waam_plan', 'waam_process', 'waam_robot'},
    'waam_adapt': {'waam_node', 'waam_process', 'waam_record'},
    'waam_archive': {'waam_node', 'waam_process'},
    'waam_train': {'waam_adapt', 'waam_process'},
    'waam_job': {'waam_node', 'waam_plan', 'waam_process', 'waam_record'},
    'waam_lab': {
        'waam_adapt', 'waam_bridge', 'waam_job', 'waam_node', 'waam_plan', 'waam_process', 'waam_record', 'waam_robot',
        'waam_robot_bridge', 'waam_scan', 'waam_sim', 'waam_train', 'waam_view',
    },
    'waam_replay': {'waam_adapt', 'waam_node', 'waam_process', 'waam_record', 'waam_scan'},
    'waam_view': {'waam_node', 'waam_process', 'waam_record', 'waam_robot'},
    'waam_shop': {'waam_node', 'waam_process'},
    'waam_panel': {
        'waam_archive', 'waam_calibrate', 'waam_node', 'waam_plan', 'waam_process', 'waam_record', 'waam_shop',
        'waam_view',
    },
    'waam_bringup': {
        'waam_adapt', 'waam_bridge', 'waam_calibrate', 'waam_job', 'waam_lab', 'waam_node', 'waam_panel',
        'waam_process', 'waam_record', 'waam_scan', 'waam_shop', 'waam_view',
    },
}  # fmt: skip
NO_MESSAGES = {
    'waam_process',
    'waam_plan',
    'waam_robot',
    'waam_calibrate',
    'waam_shop',
}  # whole packages without ROS
EDGES = re.compile(
    r"""
    (\w+_node|node_\w+|ros_\w+|conversions|answers|cli|cli_\w+)\.py$  # nodes, messages, commands
    | /ros/ | /commands/                                        # rooms of nodes and of command lines
    | ^(waam_node|waam_bringup|waam_train)/                     # packages of plumbing, and of the desk
    """,
    re.VERBOSE,
)
TALKS_TO_THE_WORLD: dict[str, str] = {  # pattern of the file -> why; no file here may know ROS
    'waam_process/waam_process/grid.py': 'a height grid is saved and loaded in one format',
    'waam_process/waam_process/safe_files.py': 'the one way to read files that others may have written',
    'waam_process/waam_process/materials.py': 'reads the table of materials beside it',
    'waam_bridge/waam_bridge/(transport|ports).py': 'serial ports',
    'waam_bridge/waam_bridge/instruments.py': 'pyrometers on a serial port or behind Modbus',
    'waam_sim/waam_sim/compiled.py': 'hashes the sources of the kernels, so that their cache is current',
    'waam_sim/waam_sim/port.py': 'a pseudo-terminal with the controller behind it',
    'waam_sim/waam_sim/urdf_file.py': 'reads the URDF of the simulated arm',
    'waam_robot_bridge/waam_robot_bridge/station_file.py': 'reads the URDF of the arm',
    'waam_lab/waam_lab/robot/urdf_settings.py': 'reads a URDF, writes parameters for it',
    'waam_sim/waam_sim/table.py': 'the file of a simulated table that outlives its process',
    'waam_adapt/waam_adapt/laws/net_file.py': 'networks on disk',
    'waam_scan/waam_scan/calibration/file.py': 'calibrations on disk, with their date',
    'waam_scan/waam_scan/calibration/artefact_file.py': 'descriptions of artefacts on disk',
    'waam_scan/waam_scan/calibration/pass_file.py': 'recorded passes on disk',
    'waam_scan/waam_scan/map_file.py': 'map files',
    'waam_scan/waam_scan/registration/clouds.py': 'reads and writes clouds and meshes',
    'waam_calibrate/waam_calibrate/store.py': 'results of calibrations on disk',
    'waam_calibrate/waam_calibrate/cli.py': 'a command: its results have the date of today',
    'waam_plan/waam_plan/mesh/(arrays|clouds|package|part).py': 'read meshes and clouds',
    'waam_plan/waam_plan/texts.py': 'numpy makes numbers of lines that it is given',
    'waam_plan/waam_plan/gcode/store.py': 'plans on disk',
    'waam_plan/waam_plan/import_gcode/files.py': 'programs and dialects on disk',
    'waam_plan/waam_plan/preview/page.py': 'writes the HTML page of a plan',
    'waam_record/waam_record/bag_(copy|reader|writer).py': 'recordings on disk',
    'waam_record/waam_record/(recording|salvage).py': 'recordings on disk',
    'waam_record/waam_record/(import_command|foreign/logs).py': 'a command: reads logs of others',
    'waam_record/waam_record/file_commands.py': 'recordings on disk',
    'waam_record/waam_record/definitions.py': 'reads the definitions of messages',
    'waam_record/waam_record/provenance.py': 'asks git and the host for versions',
    'waam_replay/waam_replay/play_command.py': 'starts the player',
    'waam_replay/waam_replay/tune.py': 'tells how fast it computed',
    'waam_job/waam_job/store/.*': 'job folders on disk',
    'waam_archive/waam_archive/(arrow|export|store|verify).py': 'the files of the archive',
    'waam_archive/waam_archive/ingest.py': 'looks for job folders',
    'waam_lab/waam_lab/training_data.py': 'writes layers to train on',
    'waam_lab/waam_lab/laboratory.py': 'job folders of a run, and how long it took',
    'waam_lab/waam_lab/params.py': 'reads the parameter files of the nodes',
    'waam_lab/waam_lab/parts.py': 'writes the meshes of its parts',
    'waam_lab/waam_lab/pieces.py': 'results of an unfinished campaign on disk',
    'waam_lab/waam_lab/report.py': 'writes the report of a campaign',
    'waam_lab/waam_lab/twin/page.py': 'writes the cell file and the report of a fit',
    'waam_lab/waam_lab/twin/records.py': 'reads job folders',
    'waam_lab/waam_lab/recorded/(page|read|wall).py': 'read recordings, write the cell file and the report of a fit',
    'waam_view/waam_view/(job_data|plan_file|report_writer).py': 'job folders, plans, reports',
    'waam_view/waam_view/(drawing|viewer|web_viewer).py': 'start viewers and write their files',
    'waam_shop/waam_shop/(audit_file|durable|queue_file|shop_folder|token_file).py': 'the files of a shop',
    'waam_shop/waam_shop/(cli|cli_common|cli_access|cli_cells|cli_notify|cli_queue).py': 'commands: files, ages',
    'waam_shop/waam_shop/notifier.py': 'a thread that sends messages',
    'waam_panel/waam_panel/(alarms|history|parts|spool).py': 'read tables and job folders',
    'waam_panel/waam_panel/archive_page.py': 'asks the archive of jobs; ages are told from today',
    'waam_panel/waam_panel/(api|auditing|bodies|cell|commanding|gate|routes|security|shop_api|stream|web).py':
        'the web server',
    'waam_panel/waam_panel/background.py': 'threads for what may wait for a disk; says for how long it does',
    'waam_panel/waam_panel/stop_lane.py': 'a process that serves only STOP',
    'waam_panel/waam_panel/standoff_page.py': 'the web server',
    'waam_panel/waam_panel/(people|shop_link).py': 'the files of the shop and of jobs, once a second',
}  # fmt: skip
DECODES_MESSAGES = {
    'waam_lab',
    'waam_replay',
}  # compute with the nodes' own conversions, without nodes


class Violation(NamedTuple):
    """where: file, room or package; rule: what is wrong there."""

    where: str
    rule: str


KNOWN: dict[Violation, str] = {}  # -> whose branch mends it


@dataclass
class Table:
    """The rules above; tests put others in their place."""

    may_import: dict[str, set[str]] = field(default_factory=lambda: MAY_IMPORT)
    no_messages: set[str] = field(default_factory=lambda: NO_MESSAGES)
    edges: re.Pattern[str] = EDGES
    world: dict[str, str] = field(default_factory=lambda: TALKS_TO_THE_WORLD)
    decodes: set[str] = field(default_factory=lambda: DECODES_MESSAGES)

    def violations(self, workspace: Workspace) -> set[Violation]:
        return (
            circle_violations(workspace)
            | self.package_violations(workspace)
            | self.core_violations(workspace)
        )

    def package_violations(self, workspace: Workspace) -> set[Violation]:
        """Imports of packages that are not in the table, or not in package.xml."""
        found = set()
        for package, used in workspace.used_packages().items():
            allowed = self.may_import.get(package, set())
            if package not in self.no_messages:
                allowed = allowed | {MESSAGES}
            found |= {Violation(package, f'may not import {name}') for name in used - allowed}
            missing = used - workspace.declared(package)
            found |= {
                Violation(package, f'package.xml does not declare {name}') for name in missing
            }
        return found

    def core_violations(self, workspace: Workspace) -> set[Violation]:
        """ROS, clock and I/O where they do not belong."""
        found = set()
        for module in workspace.modules.values():
            if self.edges.search(module.file) and module.package not in self.no_messages:
                continue
            rules = set() if self._talks(module.file) else impurities(module)
            if module.name in workspace.know_ros and module.package not in self.decodes:
                rules.add('ROS')
            found |= {Violation(module.file, f'{rule} in a core') for rule in rules}
        return found

    def _talks(self, file: str) -> bool:
        patterns = (self.edges.search(file), *(re.fullmatch(p, file) for p in self.world))
        return any(patterns)


def circle_violations(workspace: Workspace) -> set[Violation]:
    found = workspace.circles()
    files = (workspace.modules[name].file for circle in found['files'] for name in circle)
    return (
        {Violation(file, 'circle of files') for file in files}
        | {Violation(room, 'circle of rooms') for circle in found['rooms'] for room in circle}
        | {Violation(name, 'circle of packages') for circle in found['packages'] for name in circle}
    )
