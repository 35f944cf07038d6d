"""A case of mean curves: the source of its sample, indenter and material, and the curve that is fitted in each direction."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from indentfit.case.template import template
from indentfit.errors import RecordError

KINDS = ("mean", "linear", "quadratic")


@dataclass(frozen=True)
class MeanCase:
    """The ingredients, beside the mean curves, of the case that `process --case` writes.

    Attributes
    ----------
    tree : dict
        The TOML tables that give sample, indenter, material and so on.
    base : Path or None
        The case file that holds these tables; None for the template of `indentfit init`.
    targets : dict
        Direction -> the curve for the fit: "mean" (the default), or its "linear" or "quadratic" fit.
    """

    tree: Mapping[str, Any]
    base: Path | None = None
    targets: Mapping[int, str] = field(default_factory=dict)

    @classmethod
    def read(cls, base: str | Path | None = None, targets: Mapping[int, str] | None = None) -> MeanCase:
        """The mean case with the tables of a case file, or of the template.

        Parameters
        ----------
        base : path or None
            The case file; None for the template.
        targets : mapping of directions to "mean", "linear" or "quadratic"

        Returns
        -------
        MeanCase

        Raises
        ------
        RecordError
            The case file cannot be read, or a target is unknown.
        """
        for direction, kind in (targets or {}).items():
            if kind not in KINDS:
                raise RecordError(f"target of {direction}°: {kind!r} must be one of {', '.join(KINDS)}")
        try:
            text = template() if base is None else Path(base).read_text(encoding="utf-8-sig")
        except (OSError, ValueError) as error:
            raise RecordError(f"{base}: cannot be read ({getattr(error, 'strerror', None) or error}); name a case file") from None
        try:
            return cls(tomllib.loads(text), None if base is None else Path(base), targets or {})
        except ValueError as error:
            raise RecordError(f"{base}: not TOML ({error}); correct it") from None
