"""Inputs of the model that are known with some error only: fitted too, or what their error does to the parameters.

Friction, bulk ratio, thickness and the contact point (`offset`: contact begins so much deeper, F(d - offset)) move the
curves; an estimate follows such a move as it follows noise, linearly: d theta = - estimator . dF/d input. Derivatives are
the model's own where it gives them, else differences of runs with the input changed. `force` is an error common to all
forces of a test; `mesh` is one too, its size the largest relative change that a mesh of half as many elements makes.
"""

from dataclasses import dataclass

import numpy as np

from indentfit.case import Mesh
from indentfit.fem.simulate import Model

UNITS = {"friction": "1", "bulk_ratio": "1", "thickness": "mm", "offset": "mm"}
EXACT = ("friction", "bulk_ratio", "offset")  # what the model differentiates by
STEP = 0.05  # of an input, for differences
FEWEST = 20  # elements of a mesh
LEAST_FRICTION = 0.02  # its step where the friction is small


@dataclass(frozen=True)
class Setting:
    """One point taken apart: the case with the point's inputs in place, the parameters of the material, the offset in mm, and
    whether the model of the case as it was will do (only kappa and displacements are others)."""

    case: object
    parameters: dict[str, float]
    offset: float
    same_model: bool

    def outputs(self, test):
        """Displacements of a test from the contact point, mm, (n,)."""
        return self.case.outputs(test) - self.offset


def setting(case, point):
    """The Setting of a point (name -> value): its inputs, as far as the material has no parameter of that name, leave it."""
    found = {name: value for name, value in point.items() if name in UNITS and name not in case.material_class.parameters}
    parameters = {name: value for name, value in point.items() if name not in found}
    offset = found.pop("offset", 0.0)
    for name, value in found.items():
        case = with_input(case, name, value)
    return Setting(case, parameters, offset, not {"friction", "thickness"} & set(found))


@dataclass(frozen=True)
class Shares:
    """What uncertain inputs add to the errors: covar (p, p) of all of them together; rows: name -> value, sd, effect (change
    of each parameter for one sd; of `force`, which every test has its own of, the root of the sum of squares), share (of each
    parameter's total variance)."""

    covar: np.ndarray
    rows: dict[str, dict]


def shares(case, problem, best, known):
    """Shares of the uncertain inputs of a case in the errors of a Candidate, with its Identifiability."""
    names, at = list(problem.free), setting(case, best.parameters)
    effects = {name: sd * _moves(case, problem, best, known, name) for name, sd in case.fit.uncertain.given.items()}
    covar = sum((one.T @ one for one in effects.values()), np.zeros_like(known.errors.covar))
    variance = np.diag(known.errors.covar) + np.diag(covar)
    rows = {}
    for name, one in effects.items():
        size = one[0] if len(one) == 1 else np.linalg.norm(one, axis=0)
        share = size**2 / np.where(variance > 0, variance, 1.0)
        row = {"value": value_of(at.case, name), "sd": case.fit.uncertain.given[name]}
        rows[name] = {**row, "effect": _named(names, size), "share": _named(names, share)}
    return Shares(covar, rows)


def _moves(case, problem, best, known, name):
    """Change of the estimates per unit of an input, a row for each independent error of it."""
    heavy, at = [n for n, weight in enumerate(known.weights) if weight], setting(case, best.parameters)
    if name in ("force", "mesh"):
        size = 1.0 if name == "force" else _of_mesh(at, best.forces)
        return size * np.array([B @ best.forces[n] for n, B in zip(heavy, known.errors.estimator, strict=True)])
    slopes = derivatives(at.case, at.parameters, name)
    return -np.array([sum(B @ slopes[n] for n, B in zip(heavy, known.errors.estimator, strict=True))])


def _of_mesh(at, forces):
    """The largest relative change of any test's curve on a mesh of half as many elements: of one alone it may be chance."""
    elements = max(Model(at.case).mesh_facts()["elements"] // 2, FEWEST)
    case = at.case.model_copy(update={"mesh": Mesh(elements=elements)})
    model, material = Model(case), case.material_class(**at.parameters)
    kappa, changes = case.material.bulk_modulus(material.shear_modulus), []
    for test, force in zip(case.tests, forces, strict=True):
        pressed = at.outputs(test) > 0
        coarse = model.run(material, kappa, test.angle, at.outputs(test)[pressed], test.name).force
        changes.append(np.linalg.norm(coarse - force[pressed]) / np.linalg.norm(force[pressed]))
    return float(max(changes))


def value_of(case, name):
    """The value of an uncertain input in a case; contact point and forces are what the curves say."""
    if name in ("offset", "force", "mesh"):
        return {"offset": 0.0, "force": 1.0, "mesh": 0.0}[name]
    return {"friction": case.indenter.friction, "bulk_ratio": case.material.bulk_ratio, "thickness": case.sample.thickness}[name]


def derivatives(case, parameters, name):
    """dF/d input of each test, (n,), mN per unit of the input, at these parameters."""
    material = case.material_class(**parameters)
    exact = _exact(case, material, name) if name in EXACT else None
    if exact is not None:
        return exact
    value = value_of(case, name)
    step = max(STEP * value, LEAST_FRICTION if name == "friction" else 0.0)
    pair = [_forces(with_input(case, name, one), material) for one in (value - min(step, value), value + step)]
    return [(b - a) / (step + min(step, value)) for a, b in zip(*pair, strict=True)]


def with_input(case, name, value):
    """The case with another value of an input."""
    place, key = {
        "friction": ("indenter", "friction"),
        "bulk_ratio": ("material", "bulk_ratio"),
        "thickness": ("sample", "thickness"),
    }[name]
    return case.model_copy(update={place: getattr(case, place).model_copy(update={key: value})})


def _forces(case, material):
    kappa = case.material.bulk_modulus(material.shear_modulus)
    model = Model(case)
    return [model.run(material, kappa, test.angle, case.outputs(test), test.name).force for test in case.tests]


def _exact(case, material, name):
    """The model's own sensitivities, or None where it has none."""
    kappa, model, found = case.material.bulk_modulus(material.shear_modulus), Model(case), []
    for test in case.tests:
        run = model.run(material, kappa, test.angle, case.outputs(test), test.name, sensitivities=(name,))
        if not run.sensitivities or not np.isfinite(run.sensitivities[name]).all():
            return None
        found.append(run.sensitivities[name])
    return found


def _named(names, values):
    return {name: (float(value) if np.isfinite(value) else None) for name, value in zip(names, values, strict=True)}
