"""Node `cell`: the simulated cell. A thread answers the virtual controller's steps and publishes what sensors see."""

from __future__ import annotations

import json
import math
import threading
import time
import traceback
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import PointStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool, Trigger

from waam_msgs.msg import JobStatus, ProfileBatch
from waam_msgs.srv import InjectFault, LoadPart
from waam_node.conversions import temperature_to_msg
from waam_node.node import OK, WARN, WaamNode
from waam_node.node import main as run_node
from waam_node.qos import BEAT, LATCHED, PROFILES
from waam_process.grid import HeightGrid

from . import part
from .config import CellParams, plant_params
from .conversions import Batcher, clock_to_msg
from .pace import Pace
from .plant import Plant, warm_up
from .port import PlantPort
from .shaft_plant import Chuck, ShaftPlant
from .table import kept_shaft, restore

Shaft = tuple[float, float]  # m: nominal diameter, z of its surface
CLOCK_PERIOD_US = 50_000  # of /clock, in controller time
BLANK, BLANK_LENGTH = (
    (0.040, 0.010),
    0.060,
)  # m, the shaft in a chuck until one is loaded: diameter, z of its surface
NO_CHUCK = (
    'a shaft turns in a chuck in place of the X axis, and this cell has none (chuck.steps_per_turn)'
)
CHUCK_ONLY = 'the X axis of this cell is a chuck (chuck.steps_per_turn): it clamps shafts, no part that lies still'
# of a job that computes as soon as the machine stands
COMPUTING = (JobStatus.PREPARING, JobStatus.SCANNING, JobStatus.CORRECTING, JobStatus.FINISHING)


class Cell(WaamNode):
    """Serves the plant port in its own thread; `_lock` guards the plant and the batch."""

    def __init__(self) -> None:
        super().__init__('cell', CellParams)
        p = self.params
        physics = plant_params(p)
        metal = physics.metal
        self._table = Path(p.table_file) if p.table_file else None
        self._physics, self._has_chuck = physics, p.chuck_steps_per_turn > 0
        kept, shaft = self._kept()
        if self._has_chuck:
            turn = physics.heat.cell * round(math.pi * BLANK[0] / physics.heat.cell)
            blank = part.shaft(BLANK_LENGTH, BLANK[1], metal.cell, turn)
            first, shaft = (kept, shaft) if kept else (blank, BLANK)
        else:
            length, width, thickness = p.plate
            first = kept or part.plate(length, width, thickness, metal.cell, metal.margin)
        self._plant = self._clamped(first, shaft)
        self._plant.load(first, p.seed, self._table)
        self._batcher = Batcher(self._plant.scanner.lateral, physics.scanner.batch)
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._port: PlantPort | None = None
        self._steps, self._busy, self._truths = 0, 0.0, 0
        self._job_computes = self._job_runs = False
        self._pyro_us = round(1e6 / physics.pyrometer.rate)
        self._clock_out = self.create_publisher(Clock, '/clock', BEAT)
        self._temperature_out = self.create_publisher(Temperature, 'temperature', BEAT)
        self._profiles_out = self.create_publisher(ProfileBatch, 'profiles', PROFILES)
        self.create_subscription(PointStamped, 'pyrometer_aim', self._on_aim, LATCHED)
        self.create_subscription(JobStatus, 'job_status', self._on_job, LATCHED)
        self.create_service(SetBool, 'scanner/enable', self._on_enable)
        self.create_service(LoadPart, 'cell/load_part', self._on_load)
        self.create_service(InjectFault, 'cell/inject_fault', self._on_fault)
        self.create_service(Trigger, '~/save_truth', self._on_save)
        self.create_service(Trigger, 'cell/look', self._on_look)
        self.create_timer(1.0, self._report, clock=self.steady)
        self.level, self.message = WARN, 'starting'
        self._prepare()
        self._thread = threading.Thread(target=self._live, name='plant', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the thread and hangs up."""
        self._stop.set()
        if self._port is not None:
            self._port.close()
        self._thread.join(2.0)

    def _kept(self) -> tuple[HeightGrid | None, Shaft | None]:
        """What was left in the cell, and the shaft that it is; of the other kind it is gone."""
        kept = restore(self._table) if self._table else None
        shaft = kept_shaft(self._table) if self._table else None
        if kept is None or (shaft is not None) != self._has_chuck:
            return None, None
        where = 'in the chuck' if shaft else 'on the table'
        self.get_logger().info(f'{where} lies what was left there ({self._table})')
        return kept, shaft

    def _clamped(self, lies: HeightGrid, shaft: Shaft | None) -> Plant:
        """The cell with a part on its table, or with a shaft in its chuck. ValueError for one that does not fit."""
        if shaft is None:
            return Plant(lies, self._physics, self.params.seed)
        chuck = Chuck.around(lies.spec, *shaft, self._physics.heat.cell)
        return ShaftPlant(lies, chuck, self._physics, self.params.seed)

    def _prepare(self) -> None:
        """What has to be known before the thread starts. ValueError ends the node with the text."""

    def _live(self) -> None:
        """The thread. An error in it is logged and ends the node."""
        try:
            warm_up(self._plant.params)  # seconds, where nothing is compiled yet
            if not self._stop.is_set():
                self._connect()
        except Exception:
            if self._stop.is_set() or not self.context.ok():
                return  # the node ends, and what this stood on is gone
            self.get_logger().fatal(f'the simulation failed:\n{traceback.format_exc()}')
            rclpy.try_shutdown()

    def _connect(self) -> None:
        """Connects to the controller, serves it, and connects again when it is lost."""
        waiting = False
        while not self._stop.is_set():
            try:
                self._port = PlantPort(self.params.plant_socket)
            except OSError as e:
                self.level, self.message = WARN, f'no controller at {self.params.plant_socket}: {e}'
                if not waiting:
                    self.get_logger().info(f'{self.message}; trying again')
                waiting = True
                self._stop.wait(0.2)
                continue
            waiting = False
            self.level, self.message = OK, 'connected'
            self.get_logger().info(f'connected to the controller at {self.params.plant_socket}')
            self._serve(self._port)

    def _serve(self, port: PlantPort) -> None:
        """Answers steps until the controller hangs up; the answer goes out before anything is published."""
        pace = Pace()
        try:
            while not self._stop.is_set():
                samples, time_us = port.receive()
                start = time.perf_counter()
                with self._lock:
                    placed = self._plant.placed_samples(samples)
                    port.answer(self._plant.step(placed, time_us))
                    self._publish(placed, time_us)
                self._busy += time.perf_counter() - start
                self._steps += 1
                if ahead := pace.ahead(samples, time_us, start, self._job_computes):
                    self._stop.wait(ahead)
        except OSError as e:
            if not self._stop.is_set():
                self.level, self.message = WARN, f'controller lost: {e}'
                self.get_logger().error(f'controller lost: {e}; the clock stands still')
        finally:
            port.close()

    def _publish(self, samples: np.ndarray, time_us: int) -> None:
        """Clock, temperature and profiles that are due in this step."""
        step_us = 1000 * len(samples)
        if time_us % CLOCK_PERIOD_US < step_us:
            self._clock_out.publish(clock_to_msg(time_us))
        if time_us % self._pyro_us < step_us:
            celsius = self._plant.temperature(self._pyro_us * 1e-6)
            self._temperature_out.publish(temperature_to_msg(celsius, 1000 * time_us))
        profiles = self._plant.profiles(samples)
        if profiles is not None and (msg := self._batcher.add(profiles)) is not None:
            self._profiles_out.publish(msg)

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        with self._lock:
            self._plant.scanning = request.data
            rest = None if request.data else self._batcher.flush()
            if rest is not None:
                self._profiles_out.publish(rest)
        response.success, response.message = True, 'scanner on' if request.data else 'scanner off'
        return response

    def _on_job(self, message: JobStatus) -> None:
        self._job_computes = message.state in COMPUTING
        self._job_runs = JobStatus.IDLE < message.state < JobStatus.DONE

    def _on_aim(self, message: PointStamped) -> None:
        if message.header.frame_id != 'machine':
            text = f"pyrometer_aim in frame '{message.header.frame_id}', 'machine' is wanted"
            self.get_logger().warning(text)
            return
        zero = self._plant.params.work_zero
        with self._lock:
            self._plant.aim(message.point.x - zero[0], message.point.y - zero[1])

    def _on_load(self, request: LoadPart.Request, response: LoadPart.Response) -> LoadPart.Response:
        try:
            loaded, shaft = self._part(request)
            plant = self._clamped(loaded, shaft) if shaft else None
            with self._lock:
                if self._plant.arc_on:
                    raise part.PartError('the arc is on: a part can be changed only without it')
                if self._job_runs:  # a request that waited may come in the midst of it
                    raise part.PartError('a job runs: a part can be changed only between jobs')
                seed = self.params.seed if request.seed < 0 else request.seed
                if plant is not None:
                    plant.follow(self._plant)
                    self._plant = plant
                self._plant.load(loaded, seed, self._table)
            response.message = (
                f'shaft of {shaft[0] * 1e3:g} mm in the chuck'
                if shaft
                else f'part on the table, {loaded.z.max() * 1e3:.2f} mm high'
            )
            response.success = True
        except ValueError as e:
            response.message = str(e)
        self.get_logger().info(f'load_part: {response.message}')
        return response

    def _part(self, request: LoadPart.Request) -> tuple[HeightGrid, Shaft | None]:
        """What is to be clamped, and the shaft that it is. ValueError (LoadPart.srv)."""
        metal, size = self._physics.metal, request.plate
        shaft = (size.x, size.y) if size.x > 0 and size.z == 0 else None
        if (shaft is not None) != self._has_chuck:
            raise part.PartError(CHUCK_ONLY if self._has_chuck else NO_CHUCK)
        if request.mesh_path:
            tilt = self._physics.robot.tilt
            return part.from_file(request.mesh_path, metal.cell, metal.margin, tilt), shaft
        if shaft:
            raise part.PartError('a shaft is clamped by its map: mesh_path is empty')
        return part.plate(size.x, size.y, size.z, metal.cell, metal.margin), None

    def _on_fault(
        self, request: InjectFault.Request, response: InjectFault.Response
    ) -> InjectFault.Response:
        try:
            with self._lock:
                response.message = self._plant.faults.inject(
                    request.fault, request.value, self._plant.now
                )
            response.success = True
        except ValueError as e:
            response.message = str(e)
        self.get_logger().info(f'inject_fault: {response.message}')
        return response

    def _on_save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        path = Path(self.params.truth_dir) / f'truth_{self._truths:03d}.npz'
        with self._lock:
            surface = self._plant.surface()
        try:
            surface.save_npz(path)
            self._truths += 1
            response.success, response.message = True, str(path)
        except OSError as e:
            response.message = f'{path}: {e}'
        return response

    def _on_look(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._lock:
            plant = self._plant
            seen = {
                'torch_mm': [v * 1e3 for v in plant.torch],
                'zero_mm': [v * 1e3 for v in plant.params.work_zero],
                'wire_mm': plant.fed * 1e3,
                'gas_s': plant.gassed,
                'spot_c': plant.spot_temperature,
            }
        response.success, response.message = True, json.dumps(seen)
        return response

    def _report(self) -> None:
        """Figures for the diagnostics."""
        steps, busy, self._steps, self._busy = self._steps, self._busy, 0, 0.0
        metal, arc = self._plant.metal.state[0], self._plant.arc.state[0]
        self.values.update(
            steps_per_s=steps,
            step_us=f'{busy / steps * 1e6:.1f}' if steps else '-',
            arc_starts=int(arc['starts']),
            failed_strikes=int(arc['failed']),
            deposited_mm3=f'{metal["deposited"] * 1e9:.1f}',
            lost_mm3=f'{metal["lost"] * 1e9:.1f}',
            part_mean_degC=f'{self._plant.heat.mean:.1f}',
            faults=', '.join(self._plant.faults.active) or 'none',
        )


def main() -> None:
    run_node(Cell)
