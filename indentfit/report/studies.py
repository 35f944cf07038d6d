"""The result folder of a study: its numbers, tables, figures and page."""

import json
from pathlib import Path

from .folder import case_facts, copy_case, json_text, write_json
from .html import write_report


def write_study(folder, case, result, drawing):
    """Fill the folder of a study's result; returns what its result.json holds. drawing: module with `write_tables` and `draw`."""
    again = copy_case(case, folder)
    written = json.loads(json_text({**result.as_json(), "overrides": list(again), "case": case_facts(case)}))
    write_json(folder / "result.json", written)
    drawing.write_tables(Path(folder), written)
    drawing.draw(Path(folder), written)
    write_report(folder)
    return written
