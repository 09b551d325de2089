"""What a comparison found: a line a thing that was checked, a line a difference."""

from dataclasses import dataclass, field
from pathlib import Path

DIFFERENCES_SHOWN = 20
"""Of one check; how many more there are is said instead."""


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was compared.

    Attributes:
        name: What: "header", "VLRs", "point records", ...
        compared: What was found to compare, for people.
        differences: A line each: where, what is there, what should be; empty if nothing differs.
    """

    name: str
    compared: str
    differences: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class VerifyResult:
    """What comparing a scan with its labelled copy found.

    Attributes:
        input: The scan.
        output: What was made of it.
        equal: Whether nothing but what labelling declares has changed.
        num_points: Points of the scan.
        num_changed: Points whose class code isn't what it was; None where the input has none or
            the output is none of its formats.
        declared: What labelling changed as it says it does, a line each.
        checks: All that was compared.
    """

    input: Path
    output: Path
    equal: bool
    num_points: int
    num_changed: int | None
    declared: tuple[str, ...]
    checks: tuple[Check, ...]

    @property
    def differences(self) -> tuple[str, ...]:
        """Every difference, the check's name before it."""
        return tuple(f"{check.name}: {line}" for check in self.checks for line in check.differences)


@dataclass(slots=True)
class Findings:
    """Checks being made.

    Attributes:
        num_points: Points of the input.
        num_changed: Points whose class code changed, or None.
        declared: Changes that labelling declares.
    """

    num_points: int = 0
    num_changed: int | None = None
    declared: list[str] = field(default_factory=list)
    _compared: dict[str, str] = field(default_factory=dict)
    _lines: dict[str, list[str]] = field(default_factory=dict)

    def checked(self, name: str, compared: str) -> None:
        """Note that something was compared; its differences may come before or after."""
        self._compared[name] = compared
        self._lines.setdefault(name, [])

    def differs(self, name: str, line: str) -> None:
        """Note a difference."""
        self._compared.setdefault(name, "")
        self._lines.setdefault(name, []).append(line)

    def result(self, source: Path, output: Path) -> VerifyResult:
        """All of it."""
        checks = []
        for name, compared in self._compared.items():
            lines = self._lines[name]
            more = len(lines) - DIFFERENCES_SHOWN
            if more > 0:
                lines = [*lines[:DIFFERENCES_SHOWN], f"and {more:,} more differences"]
            checks.append(Check(name, compared, tuple(lines)))
        return VerifyResult(
            input=source,
            output=output,
            equal=not any(self._lines.values()),
            num_points=self.num_points,
            num_changed=self.num_changed,
            declared=tuple(self.declared),
            checks=tuple(checks),
        )
