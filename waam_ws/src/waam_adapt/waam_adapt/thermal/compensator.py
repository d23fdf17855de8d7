"""The interpass monitor of the job that runs: its material, its limit, and the layers that its arc lays. Pure."""

from __future__ import annotations

from waam_process import materials

from .interpass import Heat, InterpassMonitor
from .params import ThermalParams
from .response import LaidLayer


class Compensator:
    """What the thermal compensator knows. Call `job_begins`, `use`, `layer_begins` and `layer_ends` as the job goes on,
    `add` for every sample of the pyrometer, `state` at any time. Times s, temperatures degC.
    """

    def __init__(self, params: ThermalParams) -> None:
        self.params = params
        self.monitor = InterpassMonitor(params.of_material, params.settings)
        self.material = self.monitor.material.name
        self._layer: tuple[str, int, int] | None = None

    @property
    def limit(self) -> float:
        """The next layer starts below this."""
        return self.monitor.settings.interpass_limit

    @property
    def error(self) -> str:
        """Why the material of the job is not known; nothing is ready then."""
        return self.monitor.material_error

    def add(self, time: float, temperature: float) -> None:
        """A reading of the pyrometer: time s (ROS), temperature degC."""
        self.monitor.add(time, temperature)

    def state(self, now: float) -> Heat:
        """What holds at ROS time `now`, s."""
        return self.monitor.state(now)

    def job_begins(self) -> None:
        """Nothing is held against the spot of the pyrometer any more."""
        self.monitor.response.forget()
        self._layer = None

    def use(self, name: str) -> bool:
        """The job's material decides; True when it is another one than before. One that the table does not hold stops
        the job: nothing is ready any more, see `error`.
        """
        if not name or name == self.material:
            return False
        self.material = name
        try:
            material = materials.get(name, self.params.materials_file or None)
        except materials.MaterialError as e:
            self.monitor.material_error = str(e)
        else:
            self.monitor.use(material, self.params.limit_of(material))
        return True

    def layer_begins(self, job_id: str, pass_number: int, layer: int) -> None:
        """Its arc is about to burn; said again and again, it counts once."""
        if (job_id, pass_number, layer) != self._layer:
            self._layer = (job_id, pass_number, layer)
            self.monitor.response.layer_begins()

    def layer_ends(self, laid: LaidLayer) -> None:
        """The arc of a layer has gone out: its heat must show within some seconds."""
        self.monitor.response.layer_ends(laid)
