"""A page in a real browser, headless, over Chromium's DevTools protocol on a pipe. Skips, with the reason, where there is none."""

import base64
import json
import os
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
KEPT = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "indentfit-tests"
PIPES = """import fcntl, os, sys
fds = [fcntl.fcntl(int(fd), fcntl.F_DUPFD, 10) for fd in sys.argv[1:3]]
os.dup2(fds[0], 3), os.dup2(fds[1], 4)  # where Chromium reads and writes
os.execv(sys.argv[3], sys.argv[3:])"""
LOOK = """(() => {
const box = e => { const r = e.getBoundingClientRect(); return [r.left, r.top, r.right, r.bottom]; };
const shown = e => e.tagName === 'IMG' ? e.complete && e.naturalWidth > 1
  : e.getBBox().width > 1 && e.querySelectorAll('path').length > 3;
return {
  width: window.innerWidth, scrolls: document.documentElement.scrollWidth,
  background: getComputedStyle(document.body).backgroundColor,
  pictures: [...document.querySelectorAll('figure svg, figure img')].map(e => ({box: box(e), whole: shown(e)})),
  texts: [...document.querySelectorAll('h1, h2, p, li, figcaption, .scroll, pre')].map(box),
  wide: [...document.querySelectorAll('.scroll, pre')].filter(e => e.scrollWidth > e.clientWidth + 1).map(e => e.ariaLabel),
  edge: getComputedStyle(document.querySelector('.lead')).borderLeftWidth, harmed: window.harmed === 1};
})()"""


class Browser:
    """One Chromium with one page."""

    def __init__(self, folder):
        program = next(filter(None, map(shutil.which, BROWSERS)), None)
        if program is None:
            pytest.skip("no Chromium or Chrome is installed (Debian: apt-get install chromium)")
        (from_us, self._to), (self._from, to_us) = os.pipe(), os.pipe()
        options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"]
        command = [program, *options, "--remote-debugging-pipe", f"--user-data-dir={folder}", "about:blank"]
        start = [sys.executable, "-c", PIPES, str(from_us), str(to_us), *command]
        self._process = subprocess.Popen(start, pass_fds=(from_us, to_us), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(from_us), os.close(to_us)
        self._rest, self._count, self._session, self.said = b"", 0, None, []
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Log", "Runtime"):
            self.ask(f"{domain}.enable")

    def close(self):
        os.close(self._to)
        self._process.terminate()
        self._process.wait(20)
        os.close(self._from)

    def open(self, page, width, dark=False):
        """Show a file at a width, CSS pixels, in a colour scheme."""
        self.said = []
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.ask("Emulation.setEmulatedMedia", features=[scheme])
        self.ask("Page.navigate", url=Path(page).absolute().as_uri())
        self._until("Page.loadEventFired")

    def run(self, script):
        """The value of a script on the page."""
        found = self.ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def screenshot(self, path):
        """Save the whole page as PNG."""
        size = self.ask("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
        shot = self.ask("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip)
        Path(path).write_bytes(base64.b64decode(shot["data"]))

    def ask(self, method, **parameters):
        """The answer to one question of the protocol."""
        self._count += 1
        question = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            question["sessionId"] = self._session
        os.write(self._to, json.dumps(question).encode() + b"\0")
        while (answer := self._next()).get("id") != self._count:
            self._hear(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _until(self, event):
        while (heard := self._next()).get("method") != event:
            self._hear(heard)

    def _hear(self, event):
        if event.get("method") == "Log.entryAdded":
            self.said.append(event["params"]["entry"]["text"])

    def _next(self):
        while b"\0" not in self._rest:
            piece = os.read(self._from, 1 << 16)
            assert piece, "the browser has ended"
            self._rest += piece
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)


def package(name, version, file):
    """One file of an npm package, fetched once."""
    folder = KEPT / f"{name}-{version}"
    if (folder / file).is_file():
        return folder / file
    if not shutil.which("npm"):
        pytest.skip(f"npm, which fetches {name}, is not installed")
    folder.mkdir(parents=True, exist_ok=True)
    command = ["npm", "pack", "--silent", "--pack-destination", str(folder), f"{name}@{version}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    if done.returncode:
        pytest.skip(f"npm could not fetch {name}@{version}: {done.stderr.strip()[-200:]}")
    with tarfile.open(next(folder.glob("*.tgz"))) as archive:
        archive.extract(file, folder, filter="data")
    return folder / file
