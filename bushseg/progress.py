"""How long-running functions say how far they are, without printing."""

from typing import Protocol


class Progress(Protocol):
    """Receives the progress of one function call; the command line draws it."""

    def start(self, stage: str, total: int | None, unit: str) -> None:
        """Begin a stage.

        Args:
            stage: What is being done, for people: "reading site.las".
            total: How many units there are, or None where that isn't known.
            unit: What is counted: "points", "tiles", "crops".
        """

    def advance(self, amount: int) -> None:
        """Report that `amount` further units of the current stage are done."""

    def note(self, message: str) -> None:
        """Report one line worth keeping, such as a warning or an epoch's metrics."""


class Silent:
    """Progress that nobody watches."""

    def start(self, stage: str, total: int | None, unit: str) -> None:
        """Ignore the stage."""

    def advance(self, amount: int) -> None:
        """Ignore the step."""

    def note(self, message: str) -> None:
        """Ignore the line."""


SILENT = Silent()
