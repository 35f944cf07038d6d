"""What the lines above a table state: the radius of the sphere, the stiffness of cantilever or load cell and its
sensitivity, the sampling rate, Poisson's ratio."""

from __future__ import annotations

import re
from collections.abc import Iterable

from indentfit.experiment.formats.words import unit_in
from indentfit.experiment.record import Stated
from indentfit.units import unit_factor

NUMBER = r"[-+]?\d+[.,]?\d*(?:[eE][-+]?\d+)?"
RADIUS = re.compile(
    r"^(?:tip|probe|indenter|sphere|spherical|ball|bead|kugel|eindringkörper)[\s_-]*(?:tip[\s_-]*)?radius|^kugelradius|^rayon", re.I
)
DIAMETER = re.compile(r"^(?:tip|probe|indenter|sphere|ball|bead|kugel)[\s_-]*(?:tip[\s_-]*)?diameter|^kugeldurchmesser", re.I)
STIFFNESS = re.compile(
    r"^k\b|^springConstant|^(?:cantilever[\s_-]*)?(?:spring[\s_-]*constant|stiffness)|^federkonstante|^cantilever[\s_-]*k\b", re.I
)
SENSITIVITY = re.compile(
    r"^(?:deflection|defl|photodetector|optical lever)[\s_.-]*(?:sensitivity\b|sens\b\.?)"
    r"|^inv(?:erse)?[\s_-]*(?:ols|optical lever sensitivity)\b",
    re.I,
)
RATE = re.compile(  # the scan rate of a force microscope counts curves, not samples
    r"^(?:sampl(?:e|ing)|acquisition|data(?:[\s_-]*acquisition)?|logging)[\s_-]*(?:rate|frequency)\b|^abtastrate|^messrate|^abtastfrequenz"
    r"|^fréquence d['\u2019]échantillonnage",
    re.I,
)
INTERVAL = re.compile(
    r"^(?:sampl(?:e|ing)|acquisition|logging)[\s_-]*(?:interval|period)\b|^abtastintervall|^dt\b|^delta[\s_-]*t\b", re.I
)
POISSON = re.compile(
    r"^(?:sample[\s_-]*)?poisson['\u2019]?s?[\s_-]*(?:ratio|number|zahl)|^querkontraktionszahl|^coefficient de poisson", re.I
)
SAMPLES = re.compile(r'"?(?:number of (?:data )?points|point count|anzahl der punkte|data points)"?\s*[:=\t;,]\s*(\d+)\b', re.I)
VALUE = re.compile(rf"(?:[\[(]\s*([^\])]+?)\s*[\])])?[\s:=;,\"\t]*({NUMBER})\s*(?:[\[(]?\s*([^\W\d][\w/µμ]*)\s*[\])]?)?")


def stated(lines: Iterable[str]) -> Stated:
    """The `Stated` facts of the lines of text above a table.

    Parameters
    ----------
    lines : iterable of str

    Returns
    -------
    Stated
        None for what the lines do not state, or state without a unit.
    """
    radius = stiffness = samples = poisson = sensitivity = rate = None
    for line in lines:
        text = line.strip().lstrip("#").strip().strip('"').strip()
        radius = radius or _length(text, RADIUS, 1.0) or _length(text, DIAMETER, 0.5)
        stiffness = stiffness or _stiffness(text)
        poisson = poisson or _poisson(text)
        sensitivity = sensitivity or _sensitivity(text)
        rate = rate or _rate(text)
        counted = SAMPLES.match(text)
        samples = samples or (int(counted[1]) if counted else None)
    return Stated(radius, stiffness, samples, poisson, sensitivity, rate)


def _length(text: str, words: re.Pattern[str], share: float) -> float | None:
    """The length, mm, times a share, that a line states after words; None where it states none."""
    number, unit = _value(text, words)
    unit = unit_in(unit or "")
    if number is None or unit is None or number <= 0:
        return None
    try:
        return share * number * unit_factor(unit, "mm")
    except ValueError:
        return None


def _stiffness(text: str) -> float | None:
    """The stiffness, mN/mm, that a line states; a "spring constant" of AFM metadata in quotes, or of JPK, is in N/m."""
    number, unit = _value(text, STIFFNESS)
    if number is None or number <= 0:
        return None
    if unit is None:
        metadata = text.casefold().startswith("spring constant") and '":' in text
        return number if metadata or text.startswith("springConstant:") else None
    try:
        return number * unit_factor(unit.replace("µ", "u").replace("μ", "u"), "mN/mm")
    except ValueError:
        return None


def _sensitivity(text: str) -> float | None:
    """The deflection of a cantilever, mm, per V of its photodetector that a line states; None where it states none with a unit."""
    number, unit = _value(text, SENSITIVITY)
    if number is None or number <= 0 or unit is None:
        return None
    try:
        return number * unit_factor(unit.replace("µ", "u").replace("μ", "u"), "mm/V")
    except ValueError:
        return None


def _rate(text: str) -> float | None:
    """The sampling rate, Hz, that a line states with its unit: as a rate, or as the time between two samples."""
    for words, target in ((RATE, "Hz"), (INTERVAL, "s")):
        number, unit = _value(text, words)
        if number is None or number <= 0 or unit is None:
            continue
        try:
            size = number * unit_factor("Hz" if unit in ("S/s", "Sa/s", "1/s") else unit_in(unit) or unit, target)
        except ValueError:
            continue
        return size if target == "Hz" else 1 / size
    return None


def _poisson(text: str) -> float | None:
    """The Poisson's ratio that a line states, up to that of a body of constant volume; None where it states none."""
    number, _ = _value(text, POISSON)
    return number if number is not None and 0 < number <= 0.5 else None


def _value(text: str, words: re.Pattern[str]) -> tuple[float | None, str | None]:
    """The number and the unit after words at the beginning of a line."""
    begin = words.match(text)
    value = begin and VALUE.match(text[begin.end() :].lstrip(" _"))
    if not value:
        return None, None
    return float(value[2].replace(",", ".")), value[1] or value[3]
