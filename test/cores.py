"""Which modules may know ROS, a clock, a disk or a socket. Who may import whom stands in `.importlinter`.

Every module is a core unless this file says otherwise. A core takes numbers and returns numbers: it knows no ROS (not
even through what it imports), no clock, no file, no socket and no other process. Time and data are arguments.

Two ways out, in the order of preference:
* put what talks to the world into a file whose name says so (EDGES);
* name a file whose purpose it is to talk to the world, with the purpose (TALKS_TO_THE_WORLD).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Set

from purity import Module, impurities

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
    'waam_panel/waam_panel/(commission_page|standoff_page).py': 'the web server',
    'waam_panel/waam_panel/commissioning.py': 'waam commission as a process',
    'waam_panel/waam_panel/(people|shop_link).py': 'the files of the shop and of jobs, once a second',
}  # fmt: skip
DECODES_MESSAGES = {
    'waam_lab',
    'waam_replay',
}  # compute with the nodes' own conversions, without nodes


def violations(modules: Iterable[Module], know_ros: Set[str]) -> set[tuple[str, str]]:
    """File and what it may not know: 'ROS', 'clock' or 'io'. know_ros: names of the modules that import ROS, or
    something that does."""
    found = set()
    for module in modules:
        if EDGES.search(module.file) and module.package not in NO_MESSAGES:
            continue
        what = set() if _talks(module.file) else impurities(module)
        if module.name in know_ros and module.package not in DECODES_MESSAGES:
            what.add('ROS')
        found |= {(module.file, one) for one in what}
    return found


def _talks(file: str) -> bool:
    return bool(EDGES.search(file)) or any(re.fullmatch(p, file) for p in TALKS_TO_THE_WORLD)
