"""What of a file was not used: by reason, with its lines and their count."""

from __future__ import annotations

from dataclasses import dataclass, field

NAMED = 5  # lines that are named; of more the count


@dataclass
class Tally:
    """Of one file."""

    lines: dict[str, list[int]] = field(default_factory=dict)

    def add(self, reason: str, line: int) -> None:
        """A line that was left out, or a value in it."""
        self.lines.setdefault(reason, []).append(line)

    def told(self) -> list[str]:
        """'3 lines left out: not a number (lines 4, 9, 12)'."""
        found = []
        for reason, lines in self.lines.items():
            few = ', '.join(map(str, lines[:NAMED])) + (' ...' if len(lines) > NAMED else '')
            found.append(f'{len(lines)} {reason} (line{"s" * (len(lines) > 1)} {few})')
        return found
