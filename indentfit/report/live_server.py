"""The page of a running fit, served to this machine alone: 127.0.0.1, no file of the disk, nothing from the network."""

from __future__ import annotations

import base64
import hashlib
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

HOST = "127.0.0.1"
AGAIN = 2000  # ms between two looks of the page
SCRIPT = """
const place = document.getElementById("content");
let shown = "";
async function look() {
  try {
    const answer = await fetch("now", { cache: "no-store" });
    const text = await answer.text();
    if (answer.ok && text !== shown) { place.innerHTML = text; shown = text; }
    setTimeout(look, AGAIN);
  } catch (error) {
    const lead = document.createElement("p");
    lead.className = "lead";
    lead.textContent = "The fit has ended, or was stopped: its terminal says which, and where its report is.";
    place.prepend(lead);
  }
}
setTimeout(look, AGAIN);
""".replace("AGAIN", str(AGAIN))


@contextmanager
def served(title: str, now: Callable[[], str], port: int = 0) -> Iterator[str]:
    """Context that serves a page and gives its address; the server ends with the block.

    Parameters
    ----------
    title : str
    now : function
        Called for the inner HTML of the main part, by one request at a time.
    port : int
        0: any that is free.

    Raises
    ------
    OSError
        The port is in use.
    """
    lock = threading.Lock()

    def told() -> str:
        with lock:
            return now()

    answers = type("Answers", (_Answers,), {"title": title, "now": staticmethod(told)})
    with ThreadingHTTPServer((HOST, port), answers) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://{HOST}:{server.server_address[1]}/"
        finally:
            server.shutdown()
            thread.join()


class _Answers(BaseHTTPRequestHandler):
    """Answers `/` with the page and `/now` with its main part, to requests that name this machine."""

    title = ""
    now: Callable[[], str]
    server_version = "indentfit"
    sys_version = ""

    def do_GET(self) -> None:
        host = self.headers.get("Host", "").partition(":")[0]
        if host not in (HOST, "localhost"):  # a page of elsewhere whose name was made to point here
            self.send_error(403)
        elif self.path == "/":
            self._send(_page(self.title, self.now()), _policy())
        elif self.path == "/now":
            self._send(self.now(), "default-src 'none'")
        else:
            self.send_error(404)

    def log_message(self, format: str, *values: object) -> None:
        """Requests are not worth a line."""

    def _send(self, text: str, policy: str) -> None:
        body = text.encode()
        self.send_response(200)
        for name, value in {
            "Content-Type": "text/html; charset=utf-8",
            "Content-Length": str(len(body)),
            "Content-Security-Policy": policy,
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
        }.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)


def _style() -> str:
    return (Path(__file__).parent / "page.css").read_text(encoding="utf-8")


def _policy() -> str:
    style, script = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in (_style(), SCRIPT))
    return (
        f"default-src 'none'; style-src 'sha256-{style}'; script-src 'sha256-{script}'; connect-src 'self'; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'none'"
    )


def _page(title: str, main: str) -> str:
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{escape(title)}</title>
<style>{_style()}</style>
<noscript><meta http-equiv="refresh" content="5"></noscript>
</head>
<body>
<header><p class="kind">Fit in progress</p><h1>{escape(title)}</h1></header>
<main id="content">{main}</main>
<footer><p>Served by indentfit on this machine alone. The result does not depend on it, and it ends with the fit.</p></footer>
<script>{SCRIPT}</script>
</body>
</html>
"""
