"""Who may do what: three roles, each with everything that the one before may do."""

from __future__ import annotations

from enum import IntEnum


class Role(IntEnum):
    """VIEW looks, OPERATE also moves, starts and stops, MAINTAIN also sees the audit log and sends test messages."""

    VIEW = 1
    OPERATE = 2
    MAINTAIN = 3

    @property
    def label(self) -> str:
        """As written in files and on the command line."""
        return self.name.lower()


ROLES = tuple(r.label for r in Role)


def role_of(text: str) -> Role:
    """The role of this name. Raises ValueError that lists the names."""
    if text not in ROLES:
        raise ValueError(f'role {text!r}, must be one of {", ".join(ROLES)}')
    return Role[text.upper()]
