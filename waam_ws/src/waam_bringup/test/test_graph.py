"""The description of the graph becomes processes; mistakes in it are named."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from waam_bringup import run_state
from waam_bringup.graph import GraphError, Settings, environment, fill, load, processes
from waam_bringup.operate import graph_watch
from waam_bringup.parts import DEPTH, HEIGHT, write_parts
from waam_bringup.run_state import NodeState, RunState, describe_exit
from waam_bringup.supervisor import Supervisor, mark_interrupted


def settings(tmp_path, **changes) -> Settings:
    return Settings(run=tmp_path, **changes)


def test_jobs_are_told_the_name_of_a_cell_that_has_one(tmp_path, monkeypatch):
    def told():
        return ' '.join(
            next(p for p in processes(settings(tmp_path)) if p.name == 'job_sequencer').command
        )

    monkeypatch.delenv('WAAM_CELL', raising=False)
    assert 'shop_cell:=""' in told()
    monkeypatch.setenv('WAAM_CELL', 'cell2')
    assert 'shop_cell:="cell2"' in told()


def test_simulated_graph_has_controller_and_cell_and_real_one_has_not(tmp_path):
    simulated = {p.name: p for p in processes(settings(tmp_path))}
    real = {p.name: p for p in processes(settings(tmp_path, port='/dev/serial/by-id/x'))}
    assert set(simulated) - set(real) == {'virtual_controller', 'cell'}
    assert 'port:="/dev/serial/by-id/x"' in ' '.join(real['bridge'].command)
    assert 'use_sim_time:=true' in ' '.join(simulated['bridge'].command)
    assert 'use_sim_time:=false' in ' '.join(simulated['cell'].command)
    assert 'use_sim_time:=false' in ' '.join(real['bridge'].command)


def test_a_real_cell_has_one_source_of_temperature_and_the_simulated_one_its_own(tmp_path):
    def made(**changes):
        return {p.name: p for p in processes(settings(tmp_path, **changes))}

    def board(graph) -> str:
        return next(w for w in graph['bridge'].command if w.startswith('temperature_input'))

    simulated, bare = made(), made(port='x')
    assert board(simulated) == board(bare) == 'temperature_input:="none"'
    assert 'pyrometer' not in simulated and 'pyrometer' not in bare
    by_board = made(port='x', pyrometer='4-20mA')
    assert board(by_board) == 'temperature_input:="4-20mA"' and 'pyrometer' not in by_board
    beside = made(port='x', pyrometer='modbus:10.0.0.7:502')
    assert board(beside) == 'temperature_input:="none"'
    assert 'source:="modbus:10.0.0.7:502"' in beside['pyrometer'].command
    (lease,) = [a for a in beside['job_sequencer'].command if a.startswith('lease_nodes:=')]
    assert 'pyrometer' in lease
    robot = made(port='x', machine='robot', pyrometer='topic:/ir/spot')
    assert 'pyrometer' in robot
    with pytest.raises(GraphError, match='--pyrometer: the simulated cell has one of its own'):
        made(pyrometer='0-10V')
    with pytest.raises(GraphError, match='a robot has no controller board'):
        made(port='x', machine='robot', pyrometer='0-10V')


def test_the_simulated_gantry_takes_the_steps_of_the_parameter_file(tmp_path):
    file = tmp_path / 'own.yaml'
    file.write_text('/**/bridge: {ros__parameters: {steps_per_mm_x: 150.0, envelope_x: 3.0}}\n')

    def steps(**wanted) -> str:
        (made,) = [
            p for p in processes(settings(tmp_path, **wanted)) if p.name == 'virtual_controller'
        ]
        return made.command[made.command.index('--machine-steps') + 1]

    assert steps() == '320,320,320'
    assert steps(params_files=(file,)) == '150,320,320'
    assert steps(params_files=(file,), namespace='cell2') == '150,320,320'
    assert steps(params_files=(file,), machine_steps=(151.5, 320.0, 321.0)) == '151.5,320,321'


@pytest.mark.parametrize('machine', ['gantry', 'robot'])
def test_a_preset_is_read_after_the_defaults_of_the_cell_and_before_what_the_user_says(
    tmp_path, machine
):
    file = tmp_path / 'own.yaml'
    file.write_text('cell: {ros__parameters: {metal_transfer: 0.9}}\n')
    wanted = settings(tmp_path, preset='rough', params_files=(file,), machine=machine)
    made = {p.name: p.command for p in processes(wanted)}
    files = [
        Path(a).name
        for a, b in zip(made['cell'][1:], made['cell'], strict=False)
        if b == '--params-file'
    ]
    assert files == ['cell.yaml', 'rough.yaml', 'own.yaml']
    assert not any('rough.yaml' in word for n, c in made.items() if n != 'cell' for word in c)
    with pytest.raises(GraphError, match="--preset: .*'wild'.*gentle, recorded, rough"):
        processes(settings(tmp_path, preset='wild'))


def test_a_graph_that_names_no_preset_has_the_recorded_cell(tmp_path):
    (cell,) = [p for p in processes(settings(tmp_path)) if p.name == 'cell']
    (file,) = [w for w in cell.command if '/presets/' in w]
    assert Path(file).name == 'recorded.yaml'


def test_the_state_of_a_graph_names_the_preset_of_its_simulated_cell(tmp_path):
    made = Supervisor(settings(tmp_path, preset='recorded'), 42)
    real = Supervisor(settings(tmp_path, port='/dev/null'), 42)
    assert (made.state.preset, real.state.preset) == ('recorded', '')


def test_a_robot_stands_in_for_the_gantry_under_the_same_names(tmp_path):
    gantry = {p.name: p for p in processes(settings(tmp_path))}
    robot = {p.name: p for p in processes(settings(tmp_path, machine='robot'))}
    assert set(gantry) - set(robot) == {'virtual_controller'} and not set(robot) - set(gantry)
    assert (robot['bridge'].package, robot['bridge'].executable) == (
        'waam_robot_bridge',
        'robot_bridge',
    )
    assert robot['cell'].executable == 'robot_cell' and not robot['cell'].restart
    assert 'pace:=1.0' in robot['cell'].command
    fast = {p.name: p for p in processes(settings(tmp_path, machine='robot', rate=3.0))}
    assert 'pace:=3.0' in fast['cell'].command
    assert asks_for_real_time(settings(tmp_path, machine='robot')) >= {'cell', 'bridge'}
    real = {p.name for p in processes(settings(tmp_path, machine='robot', port='x'))}
    assert 'cell' not in real and 'bridge' in real


def test_every_ros_node_but_those_that_only_show_is_in_the_lease(tmp_path):
    specs = processes(settings(tmp_path))
    job = next(p for p in specs if p.name == 'job_sequencer')
    lease = next(a for a in job.command if a.startswith('lease_nodes:='))
    for p in specs:
        assert (p.name in lease) == (
            p.ros and p.name not in ('dashboard', 'panel', 'process_control')
        )


def asks_for_real_time(made: Settings) -> set[str]:
    return {p.name for p in processes(made) if p.environment.get('WAAM_REALTIME') == '1'}


def test_real_time_is_for_the_loop_and_only_where_the_wall_clock_counts(tmp_path):
    loop = {
        'bridge', 'scan_fusion', 'correction_server', 'feed_forward', 'thermal_compensator', 'job_sequencer',
    }  # fmt: skip
    assert asks_for_real_time(settings(tmp_path, port='/dev/ttyACM0')) == loop
    assert asks_for_real_time(settings(tmp_path, rate=1.0)) == loop | {'cell'}
    # as fast as it goes: the cell must not starve
    assert not asks_for_real_time(settings(tmp_path))
    assert not asks_for_real_time(settings(tmp_path, rate=4.0))


def test_panel_gets_its_port_and_folders_and_its_address_is_in_the_state(tmp_path, monkeypatch):
    monkeypatch.setenv('WAAM_JOBS', str(tmp_path / 'jobs'))
    made = settings(tmp_path, panel_port=8601)
    command = next(p.command for p in processes(made) if p.name == 'panel')
    assert 'port:=8601' in command and f'jobs_dir:="{tmp_path}/jobs"' in command
    folders = next(a for a in command if a.startswith('part_folders:='))
    first, second = json.loads(folders.split(':=')[1])
    assert first == f'{tmp_path}/jobs/parts' and (Path(second) / 'jaw_nominal.stl').is_file()
    assert Supervisor(made, 1).state.panel_url == 'http://127.0.0.1:8601/'
    without = settings(tmp_path, panel_port=8601, without=('panel',))
    assert Supervisor(without, 1).state.panel_url == ''


def lane_of(made: Settings) -> list[str]:
    return next((p.command[1:] for p in processes(made) if p.name == 'stop_lane'), [])


@pytest.mark.parametrize('machine', ['gantry', 'robot'])
def test_stop_has_a_second_way_beside_the_page(tmp_path, machine):
    made = settings(tmp_path, panel_port=8601, stop_port=8602, machine=machine)
    run = str(tmp_path / 'stop')
    assert lane_of(made) == ['--socket', run, '--port', '8602', '--page-port', '8601']
    commands = {p.name: p.command for p in processes(made)}
    assert f'stop_socket:="{run}"' in commands['bridge']
    assert f'stop_socket:="{run}"' in commands['panel'] and 'stop_port:=8602' in commands['panel']
    assert lane_of(settings(tmp_path, panel_port=8601)) == []
    assert lane_of(settings(tmp_path, stop_port=8602, without=('stop_lane',))) == []


def test_the_second_way_has_the_rules_that_parameter_files_give_to_the_page(tmp_path):
    """With tokens on this machine a STOP without a session would go past them."""
    first, second = tmp_path / 'a.yaml', tmp_path / 'b.yaml'
    first.write_text('panel: {ros__parameters: {token_file: /t, upload_mb: 5}}\nbridge: {}\n')
    second.write_text(
        '/**: {ros__parameters: {bind: 10.0.0.1, tls_cert: /c, tls_key: /k, token_file: /u}}'
    )
    made = settings(tmp_path, panel_port=1, stop_port=2, params_files=(first, second))
    assert lane_of(made)[6:] == [
        '--token-file', '/u', '--bind', '10.0.0.1', '--tls-cert', '/c', '--tls-key', '/k',
    ]  # fmt: skip
    for text in ('panel: 3', 'panel: {ros__parameters: [1]}'):
        first.write_text(text)
        assert (
            len(lane_of(settings(tmp_path, panel_port=1, stop_port=2, params_files=(first,)))) == 6
        )
    for text in ('', '- 5', '{'):
        first.write_text(text)
        with pytest.raises(GraphError, match='a.yaml'):
            processes(settings(tmp_path, stop_port=2, params_files=(first,)))


def test_leaving_out_an_unknown_node_is_refused(tmp_path):
    with pytest.raises(GraphError, match='rekorder'):
        processes(settings(tmp_path, without=('rekorder',)))


@pytest.mark.parametrize(
    ('text', 'word'),
    [
        ('brigde:\n  ros__parameters: {window: 500}\n', "no node 'brigde'; known are bridge"),
        ('virtual_controller:\n  ros__parameters: {}\n', "no node 'virtual_controller'"),
        ('[1, 2]', 'must hold node'),
        ('a: [', 'params.yaml'),
    ],
)
def test_a_parameter_file_for_a_node_that_there_is_not_is_refused(tmp_path, text, word):
    file = tmp_path / 'params.yaml'
    file.write_text(text)
    with pytest.raises(GraphError, match=word):
        processes(settings(tmp_path, params_files=(file,)))
    file.write_text('/**:\n  ros__parameters: {}\n/bridge:\n  ros__parameters: {}\ncell: {}\n')
    assert processes(settings(tmp_path, params_files=(file,)))


def test_unknown_key_and_variable_are_named(tmp_path):
    file = tmp_path / 'graph.yaml'
    file.write_text('bridge: {package: waam_bridge, paramters: {}}')
    with pytest.raises(GraphError, match="bridge: unknown key 'paramters'"):
        load(file)
    with pytest.raises(GraphError, match='prot'):
        fill('${prot}', settings(tmp_path), [])


def test_the_cell_is_looked_for_on_this_computer_only_unless_somebody_says_otherwise():
    made = environment({})
    assert made['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert Path(made['FASTRTPS_DEFAULT_PROFILES_FILE']).exists()
    assert environment({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}) == {'PYTHONUNBUFFERED': '1'}
    own = environment({'FASTRTPS_DEFAULT_PROFILES_FILE': '/mine.xml'})
    assert own == {'PYTHONUNBUFFERED': '1', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}


def test_state_survives_the_disk_and_a_dead_supervisor_is_noticed(tmp_path):
    state = RunState(os.getpid(), 'up', 7, True, 'port', nodes={'a': NodeState(1, -9, 2.0)})
    state.save(tmp_path)
    loaded = run_state.load(tmp_path)
    assert loaded == state and loaded.alive and list(loaded.dead_nodes) == ['a']
    child = subprocess.Popen([sys.executable, '-c', ''])
    child.wait()
    loaded.supervisor = child.pid
    assert not loaded.alive
    assert describe_exit(-9) == 'killed by SIGKILL' and describe_exit(2) == 'exited with 2'


@pytest.mark.parametrize('how', [['--foreground'], []])
def test_a_second_graph_in_one_folder_is_refused_by_name_and_leaves_the_first_alone(tmp_path, how):
    state = RunState(4711, 'up', 5, True, 'port')
    command = [sys.executable, '-m', 'waam_bringup.cli', 'up', '--run', str(tmp_path), *how]
    with run_state.held(tmp_path):
        state.save(tmp_path)
        ran = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert ran.returncode == 2, ran.stderr
    assert f'a graph is up already in {tmp_path} (supervisor: pid 4711)' in ran.stderr
    assert run_state.load(tmp_path) == state and not (tmp_path / 'logs').exists()
    with run_state.held(tmp_path), pytest.raises(run_state.RunInUse), run_state.held(tmp_path):
        pass


@pytest.mark.parametrize('before,after', [('DEPOSITING', 'INTERRUPTED'), ('DONE', 'DONE')])
def test_job_of_a_dead_sequencer_is_marked(tmp_path, before, after):
    job = tmp_path / 'job_folder'
    job.mkdir()
    (job / 'status.json').write_text(json.dumps({'state': before, 'message': 'm'}))
    (tmp_path / 'job').write_text(str(job))
    mark_interrupted(tmp_path, 'job_sequencer killed by SIGKILL')
    status = json.loads((job / 'status.json').read_text())
    assert status['state'] == after
    assert ('SIGKILL' in status['message']) == (before != after)


def test_demo_parts_are_closed_bodies_of_the_same_outline(tmp_path):
    import trimesh

    meshes = [trimesh.load(p) for p in write_parts(tmp_path)]
    for nominal, worn in (meshes[:2], meshes[2:]):
        assert nominal.is_watertight and worn.is_watertight
        assert (nominal.bounds == worn.bounds).all()
        assert nominal.volume > worn.volume > 0
    worn = meshes[1]
    assert (
        HEIGHT - DEPTH - 1 < worn.vertices[worn.vertices[:, 2] > 1][:, 2].min() < HEIGHT - DEPTH + 2
    )


def test_shipped_parts_are_those_of_the_generator(tmp_path):
    shipped = Path(__file__).parents[1] / 'parts'
    for made in write_parts(tmp_path):
        assert made.read_bytes() == (shipped / made.name).read_bytes()


def test_a_sequencer_that_was_started_again_ends_the_wait_for_its_job(tmp_path):
    """It has forgotten the job: whoever waits for the result would wait for ever."""
    state = RunState(os.getpid(), 'up', 7, True, 'port', nodes={'job_sequencer': NodeState(1)})
    state.save(tmp_path)
    trouble = graph_watch(tmp_path)
    assert trouble() == ''
    state.nodes['job_sequencer'] = NodeState(2, restarts=1, reason='it hung')
    state.save(tmp_path)
    assert trouble() == 'it hung; the job is interrupted'
    assert graph_watch(tmp_path)() == '', 'of a job that begins afterwards'


def test_every_node_is_in_one_group_of_the_diagnostics():
    """As stock diagnostic_aggregator matches names: by how they begin."""
    text = (Path(__file__).parents[1] / 'config' / 'diagnostics.yaml').read_text()
    groups = [
        g for g in yaml.safe_load(text)['/**']['ros__parameters'].values() if isinstance(g, dict)
    ]
    begins = [begin for group in groups for begin in group['startswith']]
    names = {d.get('name', n) for n, d in load().items() if d.get('ros', True)}
    assert {n: sum(f'{n}: state'.startswith(b) for b in begins) for n in names} == dict.fromkeys(
        names, 1
    )
    assert len(begins) == len(names)
