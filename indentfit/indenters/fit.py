"""How wide an indenter may be on a sample, and which other sizes to try."""

from collections.abc import Iterator

from indentfit.digits import sizes

WIDEST_INDENTER = 0.9  # of the sample's width: the free border beside a wider indenter is too narrow to mesh and to trust


def too_wide(key: str, width: float, across: float) -> Iterator[tuple[str, str]]:
    """The fault of a contact that leaves no free border on a sample that is `across` mm wide."""
    room = WIDEST_INDENTER * across
    if width >= room:
        yield key, f"too wide for the sample of {sizes(room / WIDEST_INDENTER)}; it must stay below {sizes(room)}"


def other_sizes(key: str, size: float, across: float) -> Iterator[tuple[str, float]]:
    """Half and twice the size, where they leave a free border on a sample that is `across` mm wide."""
    yield from ((key, factor * size) for factor in (0.5, 2.0) if factor * size < WIDEST_INDENTER * across)
