"""The twelve problems: what is told to a tool, what is true, and how the curve is computed. `python problems.py` writes them.

Each folder holds case.toml (what is told, in indentfit's form: shapes and sizes in mm) and one or two curves. truth.csv holds the
truths.
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from forward import cone, isotropic, layer, sticking_punch, strip_stiffness, with_fibres

HERE = Path(__file__).parent
POINTS, SEED = 25, 2026
ISOTROPIC = (
    'model = "neo_hookean"\npoisson_ratio = {nu}\n\n[material.parameters]\nyoung = {{ start = {start}, min = {low}, max = {high} }}'
)
FIBRES = (
    'model = "transversely_isotropic"\nbulk_ratio = 10\n\n[material.parameters]\nmu = { start = 1, min = 0.1, max = 10 }\n'
    "zeta = { start = 3, min = 0, max = 20 }\nphi = { start = 1, min = 0, max = 5 }"
)


@dataclass(frozen=True)
class Problem:
    """One problem. curves: test -> (angle or None, forces at depths); the tables [sample], [indenter] and others are text."""

    name: str
    words: str
    truth: dict[str, float]
    sample: str
    indenter: str
    material: str
    depth: float
    curves: dict[str, tuple[int | None, Callable[[np.ndarray], np.ndarray]]]
    noise: float = 0.01
    late: float = 0.0
    fit: str = ""


def material(nu: float, young: float) -> str:
    """The table [material] of an isotropic sample; the start is not the truth."""
    return ISOTROPIC.format(nu=nu, start=young / 2.5, low=young / 50, high=young * 50)


def disc(diameter: float, thickness: float, base: str) -> str:
    """The table [sample] of a disc."""
    return f'shape = "disc"\ndiameter = {diameter}\nthickness = {thickness}\nbase = "{base}"'


def sphere(radius: float, young: float, nu: float, thickness: float, bonded: bool) -> Callable[[np.ndarray], np.ndarray]:
    """Force of a paraboloid on a layer."""
    return lambda d: layer(young, nu, thickness, bonded, lambda r: r**2 / (2 * radius), 1.3 * np.sqrt(2 * radius * d.max()), d)


def flat(a: float, young: float, nu: float, thickness: float) -> Callable[[np.ndarray], np.ndarray]:
    """Force of a smooth flat punch on a bonded layer."""
    return lambda d: layer(young, nu, thickness, True, np.zeros_like, a, d)


def strip(stiffness: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Force of a smooth strip of 2 mm on a block of 6 x 3 x 10 mm."""
    return lambda d: strip_stiffness(stiffness, (6, 3, 10), 2.0) * d


def fibres(angle: float) -> np.ndarray:
    """The stiffness of the sample with fibres, which lie at an angle to the strip."""
    return with_fibres(1.5, 4.0, 0.7, 15.0, np.array([np.cos(np.radians(angle)), 0.0, np.sin(np.radians(angle))]))


SPHERE, PUNCH = 'shape = "sphere"\nradius = 8\nfriction = 0', 'shape = "cylinder"\ndiameter = 2\nfriction = 0'
BLOCK = 'shape = "block"\nlength = 6\nwidth = 10\nthickness = 3\nbase = "sliding"'
STRIP = 'shape = "strip"\nwidth = 2\nlength = 8\nfriction = 0'
THIN = sphere(8, 9, 0.495, 1, True)
PROBLEMS = (
    Problem("sphere_thick", "a sphere on a thick gel", {"E": 9.0}, disc(60, 30, "bonded"), SPHERE, material(0.45, 9), 0.02,
            {"press": (None, sphere(8, 9, 0.45, 30, True))}),
    Problem("sphere_thin", "a sphere on a thin, bonded, nearly incompressible gel", {"E": 9.0}, disc(16, 1, "bonded"), SPHERE,
            material(0.495, 9), 0.0125, {"press": (None, THIN)}),
    Problem("sphere_sliding", "a sphere on a thin, compressible layer that slides", {"E": 9.0}, disc(16, 1, "sliding"), SPHERE,
            material(0.3, 9), 0.0125, {"press": (None, sphere(8, 9, 0.3, 1, False))}),
    Problem("sphere_noisy", "the thin gel, with noise of 8 % of the largest force", {"E": 9.0}, disc(16, 1, "bonded"), SPHERE,
            material(0.495, 9), 0.0125, {"press": (None, THIN)}, noise=0.08),
    Problem("punch_thin", "a flat punch on a bonded layer (cartilage)", {"E": 520.0}, disc(16, 2, "bonded"), PUNCH,
            material(0.3, 520), 0.02, {"press": (None, flat(1, 520, 0.3, 2))}),
    Problem("punch_thick", "a flat punch on a thick gel", {"E": 9.0}, disc(60, 30, "bonded"), PUNCH, material(0.45, 9), 0.02,
            {"press": (None, flat(1, 9, 0.45, 30))}),
    Problem("cone_thick", "a blunt cone on a thick gel", {"E": 9.0}, disc(60, 30, "bonded"),
            'shape = "cone"\nhalf_angle = 86\ndiameter = 6\nfriction = 0', material(0.45, 9), 0.05,
            {"press": (None, lambda d: cone(9, 0.45, 86, d))}),
    Problem("strip", "a strip across a block", {"E": 9.0}, BLOCK, STRIP, material(0.45, 9), 0.03,
            {"press": (None, strip(isotropic(9, 0.45)))}),
    Problem("strip_fibres", "a strip along and across fibres", {"mu": 1.5, "zeta": 4.0, "phi": 0.7}, BLOCK, STRIP, FIBRES, 0.03,
            {"along": (0, strip(fibres(0))), "across": (90, strip(fibres(90)))}),
    Problem("late_contact", "the thin gel, its contact found 6 % of the depth late; the point is stated to 0.00075 mm", {"E": 9.0},
            disc(16, 1, "bonded"), SPHERE, material(0.495, 9), 0.0125, {"press": (None, THIN)}, late=0.00075,
            fit="[fit.uncertain]\noffset = 0.00075"),
    Problem("wrong_thickness", "the thin gel, its thickness told 8 % too large and stated to 0.1 mm", {"E": 9.0},
            disc(16, 1.08, "bonded"), SPHERE, material(0.495, 9), 0.0125, {"press": (None, THIN)},
            fit="[fit.uncertain]\nthickness = 0.1"),
    Problem("sticking_punch", "a punch that sticks to a thick gel, its friction unknown", {"E": 9.0}, disc(80, 40, "bonded"),
            PUNCH.replace("friction = 0", 'friction = "unknown"'), material(0.3, 9), 0.02,
            {"press": (None, lambda d: sticking_punch(9, 0.3, 1, d))}),
)  # fmt: skip


def write(problem: Problem, folder: Path) -> None:
    """Write the case and the curves of a problem."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([SEED, [known.name for known in PROBLEMS].index(problem.name)])
    depth = problem.depth * np.linspace(1 / POINTS, 1, POINTS)
    tests = []
    for name, (angle, forward) in problem.curves.items():
        force = forward(depth)
        force = force + problem.noise * force.max() * rng.normal(size=POINTS)
        seen = depth - problem.late
        rows = [f"{x:.6g},{y:.6g}" for x, y in zip(seen, force, strict=True) if x > 0]
        (folder / f"{name}.csv").write_text("\n".join(["displacement_mm,force_mN", *rows, ""]), encoding="utf-8")
        turned = "" if angle is None else f"angle = {angle}\n"
        tests.append(f'[[test]]\nname = "{name}"\n{turned}curve = "{name}.csv"\nsynthetic = true\n')
    tables = (("sample", problem.sample), ("indenter", problem.indenter), ("material", problem.material))
    head = f'# {problem.words}; written by problems.py\ntitle = "benchmark: {problem.name}"\n'
    parts = [head, *(f"[{table}]\n{keys}\n" for table, keys in tables), *tests, *([f"{problem.fit}\n"] if problem.fit else [])]
    (folder / "case.toml").write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    for problem in PROBLEMS:
        write(problem, HERE / problem.name)
    with open(HERE / "truth.csv", "w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("problem", "parameter", "truth", "unit"))
        for problem in PROBLEMS:
            for name, value in problem.truth.items():
                rows.writerow((problem.name, name, value, "1" if name in ("zeta", "phi") else "kPa"))
