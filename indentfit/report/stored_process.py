"""The result of `process` as summary.json of its folder holds it, in the form of this version or of 0.1."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pydantic import TypeAdapter

from indentfit.experiment.relaxation import Prony
from indentfit.experiment.replicates import Difference, Spread, Statistics


@dataclass(frozen=True)
class StoredRecord:
    """One record that could be used.

    Parameters
    ----------
    slope, slope_stderr : float, mN/mm
        Stiffness, and its standard error.
    r_squared : float
        R2 of the straight line.
    contact, contact_uncertainty : float, mm
        Contact point, and half of its 95 % interval.
    velocity : float, mm/s
    strain_rate : float or None, 1/s
    depth : float, mm
    peak : float, mN
    relaxation : Prony or None
    curve : str
        CSV of the loading curve, relative to the folder.
    notes : tuple of sentences
    rating, taken : str
        The rating in words, and what was taken from the file; empty where the folder is of an older version.
    method : str
        Of the contact point.
    hertz : (modulus, half of its 95 % interval) or None, kPa
        E / (1 - nu^2) by Hertz, where the radius of a sphere is known.
    peak_uncertainty : float or None, mN
        Half of the 95 % interval of the peak; None where the folder is of an older version.
    """

    slope: float
    slope_stderr: float
    r_squared: float
    contact: float
    contact_uncertainty: float
    velocity: float
    strain_rate: float | None
    depth: float
    peak: float
    relaxation: Prony | None
    curve: str
    notes: tuple[str, ...]
    rating: str = ""
    taken: str = ""
    method: str = ""
    hertz: tuple[float, float] | None = None
    peak_uncertainty: float | None = None

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "StoredRecord":
        """The numbers of one record."""
        line, contact, series = value["linear"], value["contact"], value["relaxation"]
        return cls(
            slope=line["slope"],
            slope_stderr=line["stderr"],
            r_squared=line["r_squared"],
            contact=contact["displacement"],
            contact_uncertainty=contact["uncertainty"],
            velocity=value["velocity_mm_per_s"],
            strain_rate=value["strain_rate_per_s"],
            depth=value["depth_mm"],
            peak=value["peak_mN"],
            relaxation=None if series is None else TypeAdapter(Prony).validate_python(_with_nan(series)),
            curve=value["curve"],
            notes=tuple(value["notes"]),
            rating=value.get("rating", ""),
            taken=value.get("taken", ""),
            method=contact.get("method", ""),
            hertz=None if (hertz := value.get("hertz")) is None else (hertz["modulus"], hertz["interval"]),
            peak_uncertainty=value.get("peak_uncertainty_mN"),
        )


@dataclass(frozen=True)
class StoredProcess:
    """Processed records with their statistics.

    Parameters
    ----------
    records : dict of name -> StoredRecord
    problems : dict of name -> why the record could not be used
    statistics : Statistics
    """

    FORMAT: ClassVar[str] = "indentfit.process/2"

    records: dict[str, StoredRecord]
    problems: dict[str, str]
    statistics: Statistics

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "StoredProcess":
        """The result that summary.json holds."""
        named = {_name(record): record for record in value["records"]}
        return cls(
            records={name: StoredRecord.from_json(record) for name, record in named.items() if record["status"] == "ok"},
            problems={name: record["problem"] for name, record in named.items() if record["status"] != "ok"},
            statistics=_statistics(value),
        )


def _name(record: Mapping[str, Any]) -> str:
    return str(record["sample"]) + ("" if record["direction"] is None else f" {record['direction']}°")


def _statistics(value: Mapping[str, Any]) -> Statistics:
    ratio = value["ratio_90_to_0"]
    return Statistics(
        stiffness={int(direction): _spread(spread) for direction, spread in value["stiffness_mN_per_mm"].items()},
        ratio=None if ratio is None else _spread(ratio),
        differences=TypeAdapter(tuple[Difference, ...]).validate_python(value["differences"]),
    )


def _spread(value: Mapping[str, Any]) -> Spread:
    return TypeAdapter(Spread).validate_python(_with_nan(value))


def _with_nan(value: Any) -> Any:
    """A value with NaN in place of null, which stands for NaN in JSON."""
    if isinstance(value, Mapping):
        return {name: _with_nan(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_with_nan(inner) for inner in value]
    return float("nan") if value is None else value
