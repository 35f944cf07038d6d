"""What a material is: an energy in isochoric invariants; deriving, finding, loading, typing and checking one.

    from indentfit.material import Material, Parameter, exp

    class Demiray(Material):
        "psi = mu/(2 b) (exp(b (I1 - 3)) - 1)"
        mu = Parameter("kPa", "shear modulus", min=0, scale=True)
        b = Parameter("1", "stiffening", min=0.01)

        def energy(self, I1):
            return self.mu / (2 * self.b) * (exp(self.b * (I1 - 3)) - 1)

Files of laws, and the other rooms, import from here only.
"""

from indentfit.material.conformance import Check, check, isochoric_stress
from indentfit.material.functions import FUNCTIONS, Term, exp, expi, log, positive, sqrt
from indentfit.material.homogeneous import NO_EFFECT, Fibres, HomogeneousState, Kind, Stresses
from indentfit.material.kinematics import INVARIANTS, REST, SECOND_FAMILY, families, invariant_gradients, invariants
from indentfit.material.layers import Layered, laws_of, layered, parts_of
from indentfit.material.model import FIRST_FAMILY, GROUP, Material, exchangeable, require_derivable, shipped
from indentfit.material.pairs import sharing
from indentfit.material.parameter import Parameter
from indentfit.material.plugins import blamed, checked_derivatives, foreign_code, installed, load
from indentfit.material.prestretch import Prestretched, rest_pressure, rest_pressure_changes
from indentfit.material.stability import least_shear_modulus
from indentfit.material.stretches import STRETCHES
from indentfit.material.trials import trial_values
from indentfit.material.typed_energy import typed

__all__ = [
    "FIRST_FAMILY",
    "FUNCTIONS",
    "GROUP",
    "INVARIANTS",
    "NO_EFFECT",
    "REST",
    "SECOND_FAMILY",
    "STRETCHES",
    "Check",
    "Fibres",
    "HomogeneousState",
    "Kind",
    "Layered",
    "Material",
    "Parameter",
    "Prestretched",
    "Stresses",
    "Term",
    "blamed",
    "check",
    "checked_derivatives",
    "exchangeable",
    "exp",
    "expi",
    "families",
    "foreign_code",
    "installed",
    "invariant_gradients",
    "invariants",
    "isochoric_stress",
    "laws_of",
    "layered",
    "least_shear_modulus",
    "load",
    "log",
    "parts_of",
    "positive",
    "require_derivable",
    "rest_pressure",
    "rest_pressure_changes",
    "sharing",
    "shipped",
    "sqrt",
    "trial_values",
    "typed",
]
