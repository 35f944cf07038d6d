"""The page of processed records: one self-contained HTML file, every text of the user's escaped."""

import base64
import hashlib
import io

from jinja2 import Environment
from markupsafe import Markup

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
<p>{{ good }} of {{ outcomes|length }} records processed by indentfit {{ version }}. Uncertainties of contact points are
half of a 90 % interval, those of stiffnesses one standard error. Outliers are shown and counted.</p>
{% if lines %}<pre>{% for line in lines %}{{ line }}
{% endfor %}</pre>{% endif %}
{% if replicates %}<p><img alt="stiffness of the two directions" src="data:image/png;base64,{{ replicates }}"></p>{% endif %}
<h2>Records</h2>
<table><tr><th>record</th><th>stiffness, mN/mm</th><th>R²</th><th>contact, mm</th><th>velocity, mm/s</th><th>strain rate, 1/s</th>
<th>depth, mm</th><th>peak, mN</th><th>G∞/G0</th><th></th></tr>
{% for one in outcomes %}{% set done = one.processed %}<tr>
{% if done %}<td>{{ one.name }}</td><td>{{ "%.4g ± %.2g"|format(done.line.slope, done.line.stderr) }}</td>
<td>{{ "%.4f"|format(done.line.r_squared) }}</td>
<td>{{ "%.4f ± %.4f"|format(done.contact.displacement, done.contact.uncertainty) }}</td><td>{{ "%.3g"|format(done.velocity) }}</td>
<td>{{ "%.3g"|format(done.strain_rate) if done.strain_rate }}</td><td>{{ "%.4f"|format(done.depth) }}</td>
<td>{{ "%.4g"|format(done.peak) }}</td><td>{{ "%.3f"|format(done.relaxation.ratio) if done.relaxation }}</td>
<td class="text">{{ "outlier? " if one.name in outlying }}{{ done.notes|join("; ") }}</td>
{% else %}<td class="failed">{{ one.name }}</td><td class="text failed" colspan="9">{{ one.problem }}</td>{% endif %}</tr>
{% endfor %}</table>
{% for name, picture in pictures %}<h3>{{ name }}</h3><img alt="{{ name }}" src="data:image/png;base64,{{ picture }}">
{% endfor %}</body></html>
"""


def write_page(path, title, outcomes, lines, outlying, replicates, pictures, version):
    """Write the page. lines: the statistics in words; replicates: a figure, or None; pictures: list of (name, figure)."""
    page = Environment(autoescape=True).from_string(PAGE)
    text = page.render(
        title=title,
        outcomes=outcomes,
        good=sum(one.processed is not None for one in outcomes),
        lines=list(lines),
        outlying=outlying,
        replicates=replicates and _encoded(replicates),
        pictures=[(name, _encoded(figure)) for name, figure in pictures],
        version=version,
        style=Markup(STYLE),
        style_hash=base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode(),
    )
    path.write_text(text, encoding="utf-8")


def _encoded(figure):
    """A figure as the text of a PNG."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=130, metadata={"Software": None})
    return base64.b64encode(stream.getvalue()).decode("ascii")
