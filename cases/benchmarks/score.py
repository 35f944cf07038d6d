"""Score the answers of a tool: python cases/benchmarks/score.py ANSWERS.csv

The answers are a table problem,parameter,value,low,high,determined: the estimate, its 95 % interval, and yes or no, whether the
tool calls the parameter determined. Rows that are missing count as not answered.
"""

import csv
import sys
from collections.abc import Iterable
from pathlib import Path
from statistics import median

HERE = Path(__file__).parent
Row = dict[str, str]


def read(path: Path) -> list[Row]:
    """The rows of a table."""
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def score(truths: Iterable[Row], answers: Iterable[Row]) -> list[tuple[str, ...]]:
    """Rows of problem, parameter, truth, value, error in percent, interval, whether it holds the truth, and verdict."""
    given = {(row["problem"], row["parameter"]): row for row in answers}
    rows = []
    for row in truths:
        key, truth = (row["problem"], row["parameter"]), float(row["truth"])
        answer = given.get(key)
        if answer is None:
            rows.append((*key, f"{truth:g}", "-", "-", "-", "-", "-"))
            continue
        value, low, high = (float(answer[name]) for name in ("value", "low", "high"))
        holds = "yes" if low <= truth <= high else "NO"
        off = f"{100 * (value / truth - 1):+.1f}"
        rows.append((*key, f"{truth:g}", f"{value:.4g}", off, f"{low:.4g} to {high:.4g}", holds, answer["determined"]))
    return rows


def summary(rows: list[tuple[str, ...]]) -> str:
    """The numbers that compare tools."""
    answered = [row for row in rows if row[3] != "-"]
    held = [row for row in answered if row[6] == "yes"]
    wrong = [row for row in answered if row[6] == "NO" and row[7] == "yes"]
    off = (
        f"{median(abs(float(row[4])) for row in answered if row[7] == 'yes'):.1f} %"
        if any(row[7] == "yes" for row in answered)
        else "-"
    )
    return (
        f"{len(answered)} of {len(rows)} parameters answered, {len(held)} intervals hold the truth, "
        f"{len(wrong)} wrong ones are called determined; median error of those that are called determined: {off}"
    )


if __name__ == "__main__":
    table = score(read(HERE / "truth.csv"), read(Path(sys.argv[1])))
    heads = ("problem", "parameter", "truth", "value", "error %", "95 % interval", "holds", "determined")
    widths = [max(len(row[n]) for row in (heads, *table)) for n in range(len(heads))]
    for line in (heads, *table):
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())
    print(summary(table))
