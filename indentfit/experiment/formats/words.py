"""The words by which headers of instruments name time, displacement and force, in several languages, and the units they write."""

from __future__ import annotations

import functools
import re

TARGETS = {"time": "s", "displacement": "mm", "force": "mN"}
# Words of each quantity in ranks: where a header has several columns of a quantity, the first rank is taken.
WORDS: dict[str, tuple[str, ...]] = {
    "time": (
        "time zeit prüfzeit temps tiempo tempo 时间 時間 经过时间 elapsed tijd czas время 시간 tid aika čas zaman thời час време t",
        "ts",
    ),
    "displacement": (
        "indentation indent depth penetration separation eindringtiefe eindringweg enfoncement profondeur "
        "压入深度 深さ 押込み深さ глубина глибина дълбочина pd",
        "displacement disp extension compression weg standardweg verformung allongement déplacement deplacement desplazamiento "
        "spostamento verplaatsing przemieszczenie перемещение 位移 変位 변위 travel distance deformation deslocamento förskjutning "
        "chuyển yer переміщення преместване деформация деформація pomak deplasare perpindahan vandring carrera "
        "forskydning forskyvning siirtymä posunutí",
        "crosshead traverse traversenweg stroke ストローク hub course position stage step steps",
        "piezo height lvdt tip z d x s h",
    ),
    "force": (
        "force load kraft standardkraft prüfkraft normalkraft charge effort fuerza carga forza kracht siła сила нагрузка "
        "力 载荷 荷重 試験力 负荷 试验力 하중 усилие зусилля навантаження натоварване beban forță "
        "fn fz gram grams força síla voima kuvvet lực",
        "f p l",
    ),
}
SHORT = 4  # words of so few letters must be the whole word of a header
ASIDE = {  # a column whose header has one of these words is another quantity, or a copy
    "rate", "velocity", "speed", "geschwindigkeit", "vitesse", "strain", "dehnung", "stress", "spannung", "pressure",
    "target", "soll", "command", "demand", "setpoint", "set", "reference", "ref", "error", "std", "sd", "noise",
    "energy", "work", "arbeit", "area", "stiffness", "modulus", "temperature", "frequency", "phase", "amplitude",
    "harmonic", "max", "maximum", "zero", "lateral", "count", "number", "cycle", "cycles", "stamp", "raw",
}  # fmt: skip
FALLING = ("height", "höhe", "separation", "gap", "spalt", "entrefer", "隙間", "ギャップ")  # they become less under the indenter
DEFLECTIONS = ("cantilever", "defl")  # what a piezo's travel exceeds the indentation by
STAGES = ("segment", "segmentid", "stage", "phase", "seg", "abschnitt")
LENGTHS = ("pm", "nm", "um", "mm", "cm", "m", "in", "thou", "angstrom", "step")
FORCES = ("pN", "nN", "uN", "mN", "cN", "N", "kN", "mgf", "gf", "kgf", "lbf", "ozf", "dyn")
TIMES = ("us", "ms", "s", "min", "h")
ELECTRIC = ("V", "mV", "count")  # what a sensor gives before its calibration
BACKWARDS = ("rt", "retract", "retrace", "unload", "unloading")  # ends of the names of columns beside those of the approach
UNITS = (*LENGTHS, *FORCES, *TIMES, *ELECTRIC)
CAPITALS = (
    "um",
    "mm",
    "cm",
    "s",
    "gf",
    "kgf",
    "lbf",
    "ozf",
)  # that programs write in capitals, and no other unit then
KIND = {unit: kind for kind, units in (("displacement", LENGTHS), ("force", FORCES), ("time", TIMES)) for unit in units}
ALIASES = {
    "g": "gf", "mg": "mgf", "kg": "kgf", "lb": "lbf", "lbs": "lbf", "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "sek": "s", "sn": "s", "сек": "s", "msec": "ms",
    "micron": "um", "microns": "um", "micrometer": "um", "micrometers": "um", "newton": "N", "newtons": "N", "grams": "gf",
    "gram": "gf", "inch": "in", "inches": "in", "volt": "V", "volts": "V", "counts": "count",
    "cts": "count", "n": "N", "mn": "mN", "steps": "step", "秒": "s",
    "초": "s", "с": "s", "мм": "mm", "мкм": "um", "Н": "N", "мН": "mN",
    "nanometer": "nm", "nanometers": "nm", "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
    "millinewton": "mN", "millinewtons": "mN", "micronewton": "uN", "micronewtons": "uN", "nanonewton": "nN", "nanonewtons": "nN",
    "kilonewton": "kN", "kilonewtons": "kN", "milliseconds": "ms", "millisecond": "ms", "minutes": "min",
    "meter": "m", "meters": "m", "kilograms": "kgf", "pounds": "lbf", "mm.": "mm", "in.": "in", "sec.": "s",
    "kp": "kgf", "kilopond": "kgf", "dyne": "dyn", "dynes": "dyn", "mil": "thou", "mils": "thou", "å": "angstrom",
    "angstroms": "angstrom", "sekunde": "s", "sekunden": "s", "secondes": "s", "seconde": "s", "segundos": "s", "secondi": "s",
    "segundo": "s", "millisekunden": "ms", "millisecondes": "ms", "minuten": "min", "mikrometer": "um", "micromètres": "um",
    "micrometres": "um", "micrómetros": "um", "micrometri": "um", "micras": "um", "millimètres": "mm", "milímetros": "mm",
    "millimetri": "mm", "nanomètres": "nm", "nanómetros": "nm", "mikronewton": "uN", "milinewtons": "mN",
}  # fmt: skip
COMPOUND = ("zeit", "weg", "kraft", "kracht")  # that end longer German and Dutch words of the same quantity: Uhrzeit, Kolbenweg
KEPT = 2000  # texts whose meaning is kept: the tables of a force map have the same headers
EXPONENTS = {
    "pm": -12, "nm": -9, "um": -6, "mm": -3, "cm": -2, "m": 0, "pN": -12, "nN": -9, "uN": -6, "mN": -3, "cN": -2, "N": 0, "kN": 3,
    "us": -6, "ms": -3, "s": 0,
}  # fmt: skip
POWER = re.compile(  # 10^-3, x10-3, 10-3, 1e-3, x1000
    r"(?:(?<=[\s\[(])[x×·*]\s*)10\s*\^?\s*([-+]?[1-9])(?!\d)|(?<![\d.])10\s*(?:\^\s*([-+]?\d\d?)|(?<=\W10)([-+]\d\d?))(?!\d)"
    r"|(?<![\w.])(?:1\.?0*)?[eE]([-+]\d\d?)(?!\d)|(?<=[\s\[(])[x×·*]\s*10+(?![\d^])"
)
RAISED = re.compile("[⁺⁻⁰¹²³⁴-⁹]+")
PLAIN = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")
IN_BRACKETS = re.compile(r"[\[(（<]\s*([^\])）>]*?)\s*[\])）>]")
WAY = re.compile(r"_(?:ex|rt)$", re.I)  # NanoScope's extension and retraction
AT_THE_END = re.compile(r"(?:_|[,;:]\s*|/\s*|\s|-)([^\W\d_]+\.?)$")


@functools.lru_cache(KEPT)
def unit_in(text: str) -> str | None:
    """The unit that a text is, in one spelling; None where it is none."""
    text = text.strip()
    text = "um" if text in ("µ", "μ") else text.replace("µ", "u").replace("μ", "u")
    text = text if text in UNITS else ALIASES.get(text, ALIASES.get(text.casefold(), text))
    if text.casefold() in CAPITALS:
        return text.casefold()
    return text if text in UNITS else None


@functools.lru_cache(KEPT)
def unit_of_label(label: str) -> str | None:
    """The unit that a header's text gives: in brackets, after an underline, comma, slash or blank, or as the whole text."""
    label = WAY.sub("", label)
    if has_power(label):
        return _unit_with_power(label)
    for text in (*IN_BRACKETS.findall(label), *AT_THE_END.findall(label), label):
        unit = unit_in(text)
        if unit:
            return unit
    return None


def has_power(label: str) -> bool:
    """Whether a header's text has a power of ten, as in "Depth (mm x10-3)" or "Force (10^-6 N)"."""
    return POWER.search(_spelled_out(label)) is not None


def _spelled_out(label: str) -> str:
    """A header's text with its raised numbers and minus signs in plain letters."""
    return RAISED.sub(lambda match: "^" + match[0].translate(PLAIN), label).replace("−", "-")


def _unit_with_power(label: str) -> str | None:
    """The unit that a power of ten and a unit beside it make, such as "um" for "10^-3 mm"; None where no unit is so large.

    The power must stand beside the unit: "Force x10^3 (N)" has two readings, thousands of N, or N times a thousand.
    """
    label = _spelled_out(label)
    for text in [f" {text}" for text in IN_BRACKETS.findall(label)] or [label]:
        power = POWER.search(text)
        if power is None:
            continue
        words = [*text[: power.start()].split()[-1:], *text[power.end() :].split()[:1]]
        units = [unit for word in words if (unit := unit_in(word.strip(" ,;:·*×")))]
        exponent = next((int(group) for group in power.groups() if group), None)
        if len(units) != 1 or exponent is None or units[0] not in EXPONENTS:
            continue
        alike = [unit for unit in EXPONENTS if KIND[unit] == KIND[units[0]]]
        return next((unit for unit in alike if EXPONENTS[unit] == EXPONENTS[units[0]] + exponent), None)
    return None


def without_unit(label: str) -> str:
    """A header's text without a unit in brackets at its end."""
    return re.sub(r"\s*[\[(（].*?[\])）]\s*$", "", label).strip()


def words_of(label: str) -> list[str]:
    """The words of a header's text, in small letters, without the unit at its end."""
    text = IN_BRACKETS.sub(" ", WAY.sub("", label))
    end = AT_THE_END.search(text)
    if end and unit_in(end[1]) and text[: end.start()].strip():
        text = text[: end.start()]
    return [word for word in re.split(r"[\W\d_]+", text.casefold()) if word]


@functools.lru_cache(KEPT)
def rank_of(label: str, quantity: str) -> tuple[int, int] | None:
    """How well a header's text names a quantity (the rank of its words, the place of the word); None where it does not."""
    words = words_of(label)
    if quantity != "time" and ASIDE & set(words):
        return None
    for rank, group in enumerate(WORDS[quantity]):
        names = group.split()
        for place, word in enumerate(words):
            if any(_is(word, name) for name in names) and (place == 0 or _may_follow(word, quantity)):
                return rank, place
    return None


def is_deflection(label: str) -> bool:
    """Whether a header's text names the deflection of a cantilever."""
    return any(word.startswith(DEFLECTIONS) for word in words_of(label))


def is_axial(label: str) -> bool:
    """Whether a header's text names the direction z: that of the indenter, where a sensor has three."""
    return any(word in ("z", "fz") for word in words_of(label))


def is_height(label: str) -> bool:
    """Whether a header's text names a height or a gap, which becomes less while the indenter moves into the sample."""
    words = words_of(label)
    return any(word.startswith(FALLING) for word in words[:1]) or "separation" in words


def is_backwards(label: str) -> bool:
    """Whether a header's text names the way back, beside a column of the same quantity of the way to the sample."""
    words = [word for word in re.split(r"[\W\d_]+", label.casefold()) if word]
    return any(word in BACKWARDS for word in (words[:1] + words[-1:]))


def is_measured(label: str) -> bool:
    """Whether a header's text says that its quantity was measured, beside one that was only asked for."""
    return bool(re.search("measured|sensor", label, re.I))


def is_at_the_tip(label: str) -> bool:
    """Whether a header's text names the tip of a probe, beside the base that a motor moves."""
    return "tip" in words_of(label)


def is_corrected(label: str) -> bool:
    """Whether a header's text says that what the frame or the cantilever gives way is taken off, beside a raw column."""
    return bool(re.search("corrected|compensated|korrigiert|corrigé", label, re.I))


def is_stage(label: str) -> bool:
    """Whether a header's text names segments or stages of a test."""
    return words_of(label)[:1] != [] and words_of(label)[0] in STAGES


def _is(word: str, name: str) -> bool:
    if name in COMPOUND and word.endswith(name):
        return True
    if name.isascii() and len(name) < SHORT:
        return word == name
    return word == name or word.startswith(name) if name.isascii() else name in word


def _may_follow(word: str, quantity: str) -> bool:
    """Whether a word names the quantity in a later place, as in "Standard force" and "Running time"."""
    return len(word) >= SHORT if quantity != "time" else word in ("time", "zeit")
