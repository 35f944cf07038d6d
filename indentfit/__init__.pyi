from .case import Case as Case
from .case import Fit as Fit
from .case import Indenter as Indenter
from .case import MaterialChoice as MaterialChoice
from .case import Mesh as Mesh
from .case import Range as Range
from .case import Record as Record
from .case import RecordChannel as RecordChannel
from .case import Sample as Sample
from .case import Solver as Solver
from .case import Test as Test
from .curve import Curve as Curve
from .curve import read_curve as read_curve
from .curve import write_curve as write_curve
from .errors import IndentfitError as IndentfitError
from .experiment.measured import read_case as read_case
from .experiment.process import process as process
from .experiment.record import RawRecord as RawRecord
from .inference.fit import fit as fit
from .material import Material as Material
from .material import Parameter as Parameter
from .runs.forward import simulate as simulate
from .study.compare import compare as compare
from .study.design import design as design
from .study.mesh_check import mesh_check as mesh_check
from .study.sweep import sweep as sweep

__version__: str
