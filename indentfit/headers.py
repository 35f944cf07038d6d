"""The header of a curve's file: which column holds the displacement, the force, and its standard deviation, and in which units.

A column is named by a quantity and its unit, as people write them: `displacement_mm`, `Depth (um)`, `Load [gf]`, `Force / mN`,
`Force in N`; the units may stand in a line of their own below the names, and lines of text may stand above. A symbol (`h (nm)`,
`F (uN)`) counts where no word does, and the reader is told so. Words for the travel of a stage (`Stroke`, `Position`) do not count:
travel need not begin at contact.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from indentfit.errors import CurveError
from indentfit.units import unit_factor

UNITS = {"displacement": "mm", "force": "mN"}
NOUNS = {
    **dict.fromkeys(("displacement", "indentation", "depth", "penetration", "eindringtiefe"), "displacement"),
    **dict.fromkeys(("profondeur", "profundidad", "profondità"), "displacement"),
    **dict.fromkeys(("force", "load", "kraft", "fuerza", "carga", "forza"), "force"),
}
BEFORE = {
    "indentation",
    "penetration",
    "normal",
    "compressive",
    "compression",
    "applied",
    "vertical",
    "axial",
}  # words before a noun
SYMBOLS = {"displacement": {"d", "delta", "δ", "h", "w", "u"}, "force": {"f", "p", "fn"}}
TRAVEL = {"stroke", "travel", "extension", "position", "piezo", "z", "height", "crosshead", "stage", "weg"}
KINDS = {  # words in a header beside the quantity
    "retraction": {"retract", "retraction", "unload", "unloading", "return"},
    "deviation": {"sd", "std", "stdev", "se", "sem", "err", "error", "uncertainty"},
}
SAID = {
    "retraction": "the loading is read, and the retraction is left out",
    "deviation": "standard deviations of displacements are left out; fit.uncertain.offset states one of all points",
}
CAPITALS = {"MM": "mm", "UM": "um"}  # units in a header of capitals that are no other units; MN may be mN or a meganewton
UNIT_ALONE = re.compile(r"[(\[]?\s*([^\W\d_]+(?:[·*/^-]?[^\W_]+)*)\s*[)\]]?")
MOST_ABOVE = 60  # lines of text above a header
Column = tuple[int, float]  # the column's place, and the factor that converts its numbers to mm or mN


@dataclass(frozen=True)
class Label:
    """What the header of one column says: its quantity, the kind of column it is beside that, and its unit."""

    quantity: str = ""
    kind: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Header:
    """The columns of a curve's file.

    Attributes
    ----------
    cells : tuple of str
        What the header says of each.
    columns : list of (place, factor)
        Displacement, force, and the standard deviation of the force where the file has one.
    notes : tuple of str
        What a reader should know of it.
    """

    cells: tuple[str, ...]
    columns: list[Column]
    notes: tuple[str, ...]

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.cells)


def separator_of(header: str) -> str:
    """What separates the columns below a header: a semicolon, tab or comma; a blank where the header has none of them."""
    return next((mark for mark in ";\t," if mark in header), " ")


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line."""
    if separator == " ":
        parts = re.split(r"\s{2,}|\t", line.strip())
        if len(parts) == 1:
            parts = re.findall(r"[^\s(\[]+(?:\s*[(\[][^)\]]*[)\]])?", line)
        return [part.strip('"').strip() for part in parts]
    return [cell.strip().strip('"').strip() for cell in line.split(separator)]


def find_header(lines: Sequence[tuple[int, str]]) -> int:
    """The place of the header among the lines of a file: the first with a column of each quantity; 0 where no line has both."""
    for n, (_, line) in enumerate(lines[:MOST_ABOVE]):
        cells = cells_of(line, separator_of(line))
        if all(map(_is_number, cells)):
            return 0
        labels = [label_of(cell) for cell in cells]
        if {label.quantity for label in labels if not label.kind} >= set(UNITS):
            return n
    return 0


def with_units_below(header: list[str], line: str, separator: str) -> list[str] | None:
    """The header with the units of the line below it; None where that line does not hold units, or the header has its own."""
    below = cells_of(line, separator)
    units = [UNIT_ALONE.fullmatch(cell) for cell in below]
    quantities = [n for n, cell in enumerate(header) if label_of(cell).quantity and not label_of(cell).unit]
    if len(below) != len(header) or not quantities or not all(units[n] for n in quantities):
        return None
    return [f"{cell} ({unit[1]})" if unit else cell for cell, unit in zip(header, units, strict=True)]


def columns_of(where: str, header: list[str]) -> Header:
    """The columns that a header names.

    Parameters
    ----------
    where : str
        File and line, for messages.
    header : list of str
        The cells of the header.

    Raises
    ------
    CurveError
        A quantity has no column, or more than one, or a unit cannot be converted; the text says both ways on.
    """
    columns, notes = [], []
    for quantity, target in UNITS.items():
        named = [n for n, cell in enumerate(header) if label_of(cell).quantity == quantity and not label_of(cell).kind]
        places = named or _by_symbol(header, quantity)
        if len(places) != 1 or (named and not label_of(header[places[0]]).unit):
            raise CurveError(_refusal(where, header, quantity, len(named)))
        cell = header[places[0]]
        if not named:
            notes.append(f"the column {cell!r} is read as the {quantity}")
        columns.append((places[0], _factor(where, cell, label_of(cell, symbols=True).unit, target)))
    return Header(tuple(header), [*columns, *_deviations(where, header)], (*notes, *_left_out(header)))


def label_of(cell: str, symbols: bool = False) -> Label:
    """What a cell of a header says; empty where it names neither quantity, or, if asked, a symbol of one."""
    words = [word for word in re.split(r"[_\s()\[\],]+", re.sub(r"^([^()\[\]/]+?)\s*/\s*(\S+)$", r"\1 \2", cell)) if word]
    small = [word.lower() for word in words]
    first = next((n for n, word in enumerate(small) if word not in BEFORE or small[n + 1 : n + 2] == [] or word in NOUNS), 0)
    while first + 1 < len(small) and small[first] in BEFORE and small[first + 1] in NOUNS:
        first += 1
    noun = small[first] if small else ""
    quantity = NOUNS.get(noun, "")
    if not quantity and symbols and len(words) > 1:
        quantity = next((name for name, known in SYMBOLS.items() if noun in known), "")
    rest = words[first + 1 :]
    if not quantity:
        return Label()
    kind = next((kind for kind, known in KINDS.items() for word in rest if word.lower() in known), "")
    unit = [word for word in rest if word.lower() not in (*KINDS["retraction"], *KINDS["deviation"])]
    return Label(quantity, kind, "".join(unit[1:] if len(unit) > 1 and unit[0] == "in" else unit))


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _by_symbol(header: list[str], quantity: str) -> list[int]:
    """Columns whose symbol and unit both fit the quantity, in a header that has no word for the stage's travel."""
    places = []
    for n, cell in enumerate(header):
        label = label_of(cell, symbols=True)
        if label.quantity != quantity or label.kind:
            continue
        try:
            unit_factor(CAPITALS.get(label.unit, label.unit), UNITS[quantity])
        except ValueError:
            continue
        places.append(n)
    return places


def _factor(where: str, cell: str, unit: str, target: str) -> float:
    if unit == "MN":
        raise CurveError(f"{where}: column {shown(cell)} is in MN, which may mean mN or a meganewton; write mN, or N")
    try:
        return unit_factor(CAPITALS.get(unit, unit), target)
    except ValueError as error:
        raise CurveError(f"{where}: column {shown(cell)} {error}") from None


def _refusal(where: str, header: list[str], quantity: str, number: int) -> str:
    """Why a header is refused, and both ways on."""
    if all(map(_is_number, header)):
        return f"{where}: numbers and no header; write one above them that names the columns, such as Depth (mm),Force (mN)"
    names = ",".join(header)
    start = f"{where}: header {shown(names)} has "
    travel = next((cell for cell in header if TRAVEL & set(re.split(r"[_\s()\[\]/]+", cell.lower()))), None)
    if number > 1:
        more = "keep one; or a rig's own file is read as test.record, where [record] names its columns"
        return f"{start}{number} columns of {quantity}; {more}"
    wanted = f"{quantity}_{UNITS[quantity]}"
    if quantity == "displacement" and travel is not None and not number:
        return (
            f"{start}no column {wanted}; if {shown(travel)} begins at contact, rename it so; "
            "otherwise give the file as test.record, whose columns [record] names"
        )
    if number:
        cell = next(cell for cell in header if label_of(cell).quantity == quantity and not label_of(cell).kind)
        return (
            f"{start}no column {wanted}: {shown(cell)} states no unit; write for example {shown(f'{cell} ({UNITS[quantity]})')}, "
            "or give the file as test.record, whose columns [record] names"
        )
    return (
        f"{start}no column {wanted}; it must be displacement_mm,force_mN (or with other units: displacement_um); "
        "or give the file as test.record, whose columns [record] names"
    )


def _deviations(where: str, header: list[str]) -> Iterator[Column]:
    """Column and factor of the standard deviations of the forces, where there is one such column."""
    columns = [(place, cell) for place, cell in enumerate(header) if _is_deviation_of(cell, "force")]
    if len(columns) > 1:
        names = ", ".join(cell for _, cell in columns)
        raise CurveError(
            f"{where}: the header has {len(columns)} columns of standard deviations of the force, {names}; keep one of them"
        )
    for place, cell in columns:
        try:
            yield place, unit_factor(label_of(cell).unit, UNITS["force"])
        except ValueError as error:
            raise CurveError(f"{where}: column {shown(cell)} {error}; write force_sd_mN") from None


def _is_deviation_of(cell: str, quantity: str) -> bool:
    label = label_of(cell)
    return label.kind == "deviation" and label.quantity == quantity


def _left_out(header: list[str]) -> Iterator[str]:
    """What is said of columns that are left out."""
    for kind, words in SAID.items():
        cells = [cell for cell in header if label_of(cell).kind == kind and not _is_deviation_of(cell, "force")]
        if cells:
            yield f"{words}: {', '.join(cells)}"


def shown(text: str) -> str:
    """A value as it is quoted in a message: on one line and short."""
    return repr(text if len(text) <= 60 else text[:57] + "...")
