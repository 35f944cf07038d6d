"""Answers of two tools: python cases/benchmarks/answer.py indentfit|closed_forms [PROBLEM ...] writes answers/TOOL.csv.

closed_forms is what many labs do: the formulas of Hertz and Sneddon for a half-space, fitted by scipy. It knows neither thickness
nor base nor fibres, and has no formula for a strip.
"""

import csv
import json
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from forward import cone, hertz, punch
from scipy.optimize import curve_fit
from scipy.stats import t as student

HERE = Path(__file__).parent
Answer = tuple[str, str, float, float, float, str]


def indentfit(folder: Path) -> Iterator[Answer]:
    """What `indentfit fit` finds by default."""
    with tempfile.TemporaryDirectory() as place:
        program = [
            sys.executable,
            "-m",
            "indentfit",
            "-q",
            "fit",
            str(folder / "case.toml"),
            "-o",
            f"{place}/result",
            "--no-fields",
        ]
        done = subprocess.run(program, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 4):
            print(f"{folder.name}: {done.stderr.strip()}", file=sys.stderr)
            return
        result = json.loads(Path(place, "result", "result.json").read_text(encoding="utf-8"))
    parameters = result["parameters"]
    known = {"E": result["moduli"]["E"]} if "E" in result.get("moduli", {}) else {name: parameters[name] for name in result["free"]}
    verdicts = {name: parameters.get(name, parameters.get("mu", {})).get("verdict") or "" for name in known}
    for name, value in known.items():
        if value.get("interval"):
            determined = "yes" if verdicts[name].startswith("determined") and result["success"] else "no"
            yield folder.name, name, value["value"], *value["interval"], determined


def closed_forms(folder: Path) -> Iterator[Answer]:
    """What the formula of a half-space finds; an interval of the noise alone, called determined."""
    case = tomllib.loads((folder / "case.toml").read_text(encoding="utf-8"))
    indenter, nu = case["indenter"], case["material"].get("poisson_ratio")
    formulas = {
        "sphere": lambda d, young: hertz(young, nu, indenter["radius"], d),
        "cylinder": lambda d, young: punch(young, nu, indenter["diameter"] / 2, d),
        "cone": lambda d, young: cone(young, nu, indenter["half_angle"], d),
    }
    if indenter["shape"] not in formulas:
        return
    d, force = np.loadtxt(folder / case["test"][0]["curve"], delimiter=",", skiprows=1).T
    (young,), covariance = curve_fit(formulas[indenter["shape"]], d, force, p0=[10.0])
    half = float(student.ppf(0.975, d.size - 1) * np.sqrt(covariance[0, 0]))
    yield folder.name, "E", float(young), float(young) - half, float(young) + half, "yes"


TOOLS = {"indentfit": indentfit, "closed_forms": closed_forms}

if __name__ == "__main__":
    tool, *chosen = sys.argv[1:]
    with open(HERE / "truth.csv", encoding="utf-8") as file:
        names = [name for name in dict.fromkeys(row["problem"] for row in csv.DictReader(file)) if not chosen or name in chosen]
    answers = [answer for name in names for answer in TOOLS[tool](HERE / name)]
    (HERE / "answers").mkdir(exist_ok=True)
    with open(HERE / "answers" / f"{tool}.csv", "w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("problem", "parameter", "value", "low", "high", "determined"))
        rows.writerows((name, parameter, *(f"{x:.6g}" for x in numbers), verdict) for name, parameter, *numbers, verdict in answers)
