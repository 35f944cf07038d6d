"""The case: everything that a result depends on, as frozen values in mm, mN and kPa."""

from indentfit.case.messages import Fault
from indentfit.case.read import Openers, override_case, read_case_file, read_record_table
from indentfit.case.recording import Record, RecordChannel
from indentfit.case.search import Fit, Uncertain
from indentfit.case.tables import Indenter, MaterialChoice, Mesh, Range, Sample, Solver, Test
from indentfit.case.whole import Case, require_fittable
from indentfit.case.write import case_toml, write_case

__all__ = [
    "Case",
    "Fault",
    "Fit",
    "Indenter",
    "MaterialChoice",
    "Mesh",
    "Openers",
    "Range",
    "Record",
    "RecordChannel",
    "Sample",
    "Solver",
    "Test",
    "Uncertain",
    "case_toml",
    "override_case",
    "read_case_file",
    "read_record_table",
    "require_fittable",
    "write_case",
]
