"""The folder that `indentfit init` writes: the commented case with example curves."""

from pathlib import Path

import numpy as np

from indentfit.case.template import template
from indentfit.curve import Curve, write_curve
from indentfit.errors import OutputError

STIFFNESS = {"parallel": 72.9, "perpendicular": 170.5}  # mN/mm, means of Feng et al. 2017


def write_template(folder: str | Path) -> Path:
    """Write case.toml and the curves that it names.

    Parameters
    ----------
    folder : path
        The folder must be new or empty.

    Returns
    -------
    Path
        The case file.

    Raises
    ------
    OutputError
        The folder holds something, or cannot be written.
    """
    folder = Path(folder)
    _require_free(folder)
    displacement = np.round(0.33 * np.arange(1, 26) / 25, 6)
    try:
        (folder / "curves").mkdir(parents=True, exist_ok=True)
        (folder / "case.toml").write_text(template(), encoding="utf-8", newline="\n")
        for name, stiffness in STIFFNESS.items():
            write_curve(folder / "curves" / f"{name}.csv", Curve(displacement, np.round(stiffness * displacement, 6)))
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another folder") from error
    return folder / "case.toml"


def _require_free(folder: Path) -> None:
    """Refuse a folder with something in it: nothing is ever overwritten."""
    try:
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder}: a file has that name; choose another folder")
        if folder.is_dir() and any(folder.iterdir()):
            raise OutputError(f"{folder}: the folder exists and is not empty; choose another one")
    except (OSError, ValueError) as error:
        raise OutputError(f"{folder}: cannot be used ({error}); choose another folder") from error
