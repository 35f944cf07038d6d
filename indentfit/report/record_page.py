"""The page of processed records: one self-contained HTML file in which every text of the user is escaped."""

import base64
import hashlib
import io
from collections.abc import Mapping
from pathlib import Path

from jinja2 import Environment
from markupsafe import Markup
from matplotlib.figure import Figure

from indentfit.experiment.process_result import ProcessResult
from indentfit.report.records import more_lines, outlier_names

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 75em; margin: 2em auto;
  padding: 0 1em; color: #222 }
table { border-collapse: collapse; font-size: 13px } th, td { padding: .2em .7em; text-align: right; border-bottom: 1px solid #ddd }
th:first-child, td:first-child, td.text { text-align: left } .failed { color: #a33 }
img { max-width: 100% } pre { font-size: 13px; white-space: pre-wrap }
"""
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{{ title }}</title>
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'sha256-{{ style_hash }}'; \
base-uri 'none'; form-action 'none'">
<style>{{ style }}</style></head><body>
<h1>{{ title }}</h1>
<p>{{ result.records|length }} of {{ result.outcomes|length }} records processed by indentfit {{ version }}. The
uncertainty of a contact point is half of its 90 % interval, that of a stiffness one standard
error. Outliers are shown, and every number counts them.</p>
{% if lines %}<pre>{% for line in lines %}{{ line }}
{% endfor %}</pre>{% endif %}
{% if replicates %}<p><img alt="stiffness of the two directions" src="data:image/png;base64,{{ replicates }}"></p>{% endif %}
<h2>Records</h2>
<table><tr><th>record</th><th>stiffness, mN/mm</th><th>R²</th><th>contact, mm</th><th>velocity, mm/s</th><th>strain rate, 1/s</th>
<th>depth, mm</th><th>peak, mN</th><th>G∞/G0</th><th></th></tr>
{% for outcome in result.outcomes %}{% set processed = outcome.processed %}<tr>
{% if processed %}<td>{{ outcome.name }}</td><td>{{ "%.4g ± %.2g"|format(processed.line.slope, processed.line.stderr) }}</td>
<td>{{ "%.4f"|format(processed.line.r_squared) }}</td>
<td>{{ "%.4f ± %.4f"|format(processed.contact.displacement, processed.contact.uncertainty) }}</td>
<td>{{ "%.3g"|format(processed.velocity) }}</td>
<td>{{ "%.3g"|format(processed.strain_rate) if processed.strain_rate }}</td><td>{{ "%.4f"|format(processed.depth) }}</td>
<td>{{ "%.4g"|format(processed.peak) }}</td><td>{{ "%.3f"|format(processed.relaxation.ratio) if processed.relaxation }}</td>
<td class="text">{{ "outlier? " if outcome.name in outlying }}{{ processed.notes|join("; ") }}</td>
{% else %}<td class="failed">{{ outcome.name }}</td><td class="text failed" colspan="9">{{ outcome.problem }}</td>{% endif %}</tr>
{% endfor %}</table>
{% for name, picture in pictures.items() %}<h3>{{ name }}</h3><img alt="{{ name }}" src="data:image/png;base64,{{ picture }}">
{% endfor %}</body></html>
"""


def write_page(path: Path, result: ProcessResult, pictures: Mapping[str, Figure], replicates: Figure | None, version: str) -> None:
    """Write the page. pictures: name of a record -> its figure; replicates: their figure, or None where there are none."""
    text = (
        Environment(autoescape=True)
        .from_string(PAGE)
        .render(
            title="Processed records",
            result=result,
            lines=list(more_lines(result)),
            outlying=outlier_names(result.statistics),
            replicates=replicates and _encoded(replicates),
            pictures={name: _encoded(figure) for name, figure in pictures.items()},
            version=version,
            style=Markup(STYLE),
            style_hash=base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode(),
        )
    )
    path.write_text(text, encoding="utf-8")


def _encoded(figure: Figure) -> str:
    """A figure as the text of a PNG."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=130, metadata={"Software": None})
    return base64.b64encode(stream.getvalue()).decode("ascii")
