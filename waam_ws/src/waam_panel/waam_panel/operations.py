"""What an operator can make the cell do, as the web server sees it. The node implements it; tests put a fake there."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from .programs import ProgramChoice
from .setup_form import JobSetup
from .standoff_settings import StandoffSettings


class Refused(RuntimeError):
    """The machine or the job refused; the text is its message."""


class Operations(Protocol):
    """Every method blocks until the answer, at most some seconds, and raises Refused. Called from worker threads."""

    @property
    def simulated(self) -> bool:
        """A simulated cell answers: parts can be put on its table."""

    @property
    def adjustable(self) -> bool:
        """The running job takes k_gain, rescan and skip."""

    def stop(self) -> str:
        """Ends the job and stops the machine."""

    def pause(self, job_running: bool) -> str:
        """Holds the machine, and the job with it."""

    def resume(self, job_running: bool) -> str:
        """The job goes on, or without one the machine."""

    def command(self, name: str) -> str:
        """HOME, DISARM or RESET."""

    def arm(self, job: str) -> str:
        """job: name that the bridge shows while the cell is armed."""

    def jog(self, move: tuple[float, float, float], speed: float) -> str:
        """m, m/s."""

    def jog_wire(self, length: float) -> str:
        """m, negative = back."""

    def set_zero(self) -> str:
        """The present position becomes the work zero."""

    def override(self, speed: float, wire: float) -> str:
        """Factors; NaN leaves one as it is."""

    def settings(self) -> dict[str, float]:
        """Those that the controller has, by the names that set them; Refused when it does not say."""

    def standoff(self) -> StandoffSettings:
        """The settings of the standoff control."""

    def set_standoff(self, wanted: StandoffSettings) -> str:
        """Others, for the jobs to come."""

    def adjust(self, what: str, value: float) -> str:
        """SET_K_GAIN, RESCAN, SKIP_LAYER of the running job."""

    def load(self, setup: JobSetup, as_found: Path | None) -> str:
        """Simulated cell: puts the part on the table."""

    def start(self, setup: JobSetup, part: Path, jobs_dir: Path) -> str:
        """Starts a job of this part; its folder is made in `jobs_dir`."""

    def start_program(
        self, choice: ProgramChoice, program: Path, nominal: Path | None, jobs_dir: Path
    ) -> str:
        """Starts a job that lays this program as it is, with the goal of `waam job run`."""

    def resume_job(self, folder: Path) -> str:
        """Goes on with an interrupted job."""

    def restart_programs(self) -> str:
        """Programs that have died or hang are started again; which, and how they were found."""
