"""Markdown tables, as the benchmarks print them."""

import math
from collections.abc import Iterable, Sequence


def print_table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a heading and a table; the first column is text, the others are numbers.

    Args:
        title: The heading; none if empty.
        header: Names of the columns.
        rows: Cells, shown as :func:`shown` has them.
    """
    if title:
        print(f"\n### {title}\n")
    print(f"| {' | '.join(header)} |")
    print(f"|---{'|---:' * (len(header) - 1)}|")
    for row in rows:
        print(f"| {' | '.join(map(shown, row))} |", flush=True)


def shown(value: object) -> str:
    """A cell: fractions with three digits, whole numbers with commas, NaN and None as a dash."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, float):
        return f"{value:.3f}"
    return f"{value:,}" if isinstance(value, int) else str(value)
