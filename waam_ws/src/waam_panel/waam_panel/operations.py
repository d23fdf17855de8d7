"""What the web server needs of others: what an operator can make the cell do (the node), and the shop that the cell
belongs to (`shop_link`). Tests put fakes there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from waam_shop.audit_file import AuditLog
from waam_shop.notifier import Notifier
from waam_shop.queue_file import QueueFile
from waam_shop.shop_folder import Shop

from .programs import ProgramChoice
from .setup_form import JobSetup


@dataclass(frozen=True)
class StandoffSettings:
    """What the page *Standoff* sets of the controller; m. distance: NaN = what fits the source. wander: standard
    deviation of what contact tip and wire do to the current of the arc, as a distance; 0 = steady."""

    source: str
    law: str
    distance: float
    up: float
    down: float
    wander: float


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


@dataclass(frozen=True)
class Place:
    """What does not change while a panel runs. name: of the cell; domain: ROS_DOMAIN_ID; page: its address."""

    name: str
    domain: int = 0
    page: str = ''


class InShop(Protocol):
    """Queue, audit log and messages of one cell."""

    shop: Shop
    place: Place
    queue: QueueFile
    audit: AuditLog
    notifier: Notifier

    def stop_pressed(self) -> None:
        """What is released or about to start waits for a new release."""

    def tick(self, cell: Any) -> None:
        """Once a second; waits for nothing."""

    def close(self) -> None:
        """The last words of a panel."""
