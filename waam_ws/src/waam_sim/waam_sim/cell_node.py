"""Node `cell`: the simulated cell. A thread answers the virtual controller's steps and publishes what sensors see."""

from __future__ import annotations

import json
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
from waam_node.node import OK, WARN, WaamNode
from waam_node.node import main as run_node
from waam_node.qos import BEAT, LATCHED, PROFILES
from waam_process.grid import HeightGrid

from . import part
from .config import CellParams, plant_params
from .conversions import Batcher, clock_to_msg, temperature_to_msg
from .pace import Pace
from .plant import Plant, warm_up
from .port import PlantPort
from .table import restore

CLOCK_PERIOD_US = 50_000  # of /clock, in controller time
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
        kept = restore(self._table) if self._table else None
        if kept is not None:
            self.get_logger().info(f'on the table lies what was left there ({self._table})')
        length, width, thickness = p.plate
        plate = part.plate(length, width, thickness, metal.cell, metal.margin)
        self._plant = Plant(plate, physics, p.seed)
        if self._table is not None:
            self._plant.load(kept or plate, p.seed, self._table)
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
                    port.answer(self._plant.step(samples, time_us))
                    self._publish(samples, time_us)
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
            self._temperature_out.publish(temperature_to_msg(time_us, celsius))
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
            loaded = self._part(request)
            with self._lock:
                if self._plant.arc_on:
                    raise part.PartError('the arc is on: a part can be changed only without it')
                if self._job_runs:  # a request that waited may come in the midst of it
                    raise part.PartError('a job runs: a part can be changed only between jobs')
                seed = self.params.seed if request.seed < 0 else request.seed
                self._plant.load(loaded, seed, self._table)
            response.message = f'part on the table, {loaded.z.max() * 1e3:.2f} mm high'
            response.success = True
        except ValueError as e:
            response.message = str(e)
        self.get_logger().info(f'load_part: {response.message}')
        return response

    def _part(self, request: LoadPart.Request) -> HeightGrid:
        metal = self._plant.params.metal
        if request.mesh_path:
            tilt = self._plant.params.robot.tilt
            return part.from_file(request.mesh_path, metal.cell, metal.margin, tilt)
        return part.plate(
            request.plate.x, request.plate.y, request.plate.z, metal.cell, metal.margin
        )

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
