"""What a file holds, in lines of text: `indentfit process --list`."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from indentfit.digits import Scale
from indentfit.experiment.contents import Content, Segment

MOST_SEGMENTS = 12  # of a test that are listed
CHOICES = 'choose with record.block = N or NAME, sheet, cycle = N or "last", segment = NAME, rows = [A, B] or times = [A, B]'


def contents_lines(file: str | Path, contents: Sequence[Content]) -> Iterator[str]:
    """A line for each table or test of a file, and one for each of its segments."""
    good = sum(not content.problem for content in contents)
    yield f"{file}: {len(contents)} table{'s' * (len(contents) > 1)}, {good} of them records"
    for content in contents:
        yield from _content_lines(content)
    yield CHOICES


def _content_lines(content: Content) -> Iterator[str]:
    name = f" {content.name}" if content.name else ""
    if content.problem:
        yield f"  {content.number}{name}: {content.rows:,} rows, no record: {content.problem}"
        return
    cycles = f", {content.cycles} loading cycles" if content.cycles > 1 else ""
    yield f"  {content.number}{name}: {content.rows:,} rows{cycles}; {content.taken}"
    for segment in content.segments[:MOST_SEGMENTS]:
        yield f"      {_segment(segment, content.timed)}"
    if len(content.segments) > MOST_SEGMENTS:
        yield f"      and {len(content.segments) - MOST_SEGMENTS} more segments"


def _segment(segment: Segment, timed: bool) -> str:
    rate, peak = Scale.of([segment.velocity], "mm"), Scale.of([segment.peak], "mN")
    direction = f" ({segment.direction})" if segment.direction != segment.name else ""
    time = f"{segment.times[0]:.5g} to {segment.times[1]:.5g} s, " if timed else ""
    per = "s" if timed else "row"
    speed = "at rest" if segment.direction == "hold" else f"{segment.velocity * rate.factor:.3g} {rate.unit}/{per}"
    rows = f"rows {segment.rows[0]} to {segment.rows[1]}"
    return f"{segment.name}{direction}: {rows}, {time}{speed}, largest force {segment.peak * peak.factor:.4g} {peak.unit}"
