"""The names that the room of the case gives out; `__init__.py` imports each when it is first used."""

from .messages import Fault as Fault
from .read import Openers as Openers
from .read import override_case as override_case
from .read import read_case_file as read_case_file
from .read import read_record_table as read_record_table
from .recording import Record as Record
from .recording import RecordChannel as RecordChannel
from .search import Fit as Fit
from .search import Uncertain as Uncertain
from .tables import Indenter as Indenter
from .tables import MaterialChoice as MaterialChoice
from .tables import Mesh as Mesh
from .tables import Range as Range
from .tables import Sample as Sample
from .tables import Solver as Solver
from .tables import Test as Test
from .uses import asks_for_more as asks_for_more
from .uses import refusals as refusals
from .uses import require_comparable as require_comparable
from .uses import require_designable as require_designable
from .uses import require_fittable as require_fittable
from .uses import require_indentations as require_indentations
from .uses import require_known_motions as require_known_motions
from .whole import Case as Case
from .write import case_toml as case_toml
from .write import write_case as write_case
