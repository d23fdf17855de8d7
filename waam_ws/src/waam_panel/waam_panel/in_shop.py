"""What a panel needs of its shop, as the web server sees it; `shop_link` implements it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from waam_shop.audit_file import AuditLog
from waam_shop.notifier import Notifier
from waam_shop.queue_file import QueueFile
from waam_shop.shop_folder import Shop


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
