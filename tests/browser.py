"""Headless Chromium, spoken to over a pipe in its own protocol, without another package."""

import base64
import importlib.util
import json
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import pytest

PROGRAM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
NEEDED = pytest.mark.skipif(PROGRAM is None, reason="needs Chromium")
COMPILED = pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="needs ziglang")
"""Marks of tests of pages, and of live ones."""
_FLAGS = (
    "--headless=new --no-sandbox --no-first-run --disable-extensions --hide-scrollbars --use-gl=angle "
    "--use-angle=swiftshader --enable-unsafe-swiftshader --window-size=1280,760 --remote-debugging-pipe"
)


class Browser:
    """A browser with one page. `errors` are what the page wrote to the console as errors, and what it threw."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)  # Chromium may still write
        (self._reader, out), (into, self._writer) = os.pipe(), os.pipe()

        def connect() -> None:  # Chromium reads from 3 and writes to 4
            a, b = os.dup(into), os.dup(out)
            os.dup2(a, 3)
            os.dup2(b, 4)

        command = [PROGRAM or "chromium", *_FLAGS.split(), f"--user-data-dir={self._folder.name}", "about:blank"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen(command, preexec_fn=connect, close_fds=False, **quiet)
        os.close(out)
        os.close(into)
        self._buffer, self._count, self._session = b"", 0, None
        self.errors: list[str] = []
        target = next(t for t in self._call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        self._session = self._call("Target.attachToTarget", targetId=target["targetId"], flatten=True)["sessionId"]
        for domain in ("Page", "Runtime"):
            self._call(f"{domain}.enable")

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._reader)
        os.close(self._writer)
        self._folder.cleanup()

    def open(self, path: Path, fragment: str = "") -> None:
        """Open a file and wait until it is loaded."""
        self.errors.clear()
        self._call("Page.navigate", url="about:blank")  # so that another fragment of the same file loads it anew
        self._call("Page.navigate", url=f"file://{path}{f'#{fragment}' if fragment else ''}")
        while self.run("document.readyState") != "complete" or not self.run("location.href").startswith("file"):
            time.sleep(0.005)  # to ask without a pause would slow the browser down

    def run(self, script: str) -> Any:
        """The value of an expression, or of its promise, in the page."""
        done = self._call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in done:
            raise RuntimeError(str(done["exceptionDetails"]))
        return done["result"].get("value")

    def resize(self, width: int, height: int, ratio: float = 1.0) -> None:
        """Set the size of the window [pixels], and how many of the screen's pixels are one of the page."""
        size = {"width": width, "height": height, "deviceScaleFactor": ratio, "mobile": False}
        self._call("Emulation.setDeviceMetricsOverride", **size)

    def prefer(self, scheme: str) -> None:
        """Make the page light or dark."""
        self._call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def screenshot(self, path: Path) -> None:
        """Write a picture of the page."""
        path.write_bytes(base64.b64decode(self._call("Page.captureScreenshot")["data"]))

    def press(self, key: str, shift: bool = False) -> None:
        """Press and release a key, such as "Tab" or "+"."""
        text = {"text": key} if len(key) == 1 else {}
        codes = {"Tab": 9, " ": 32, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40}
        code = {"windowsVirtualKeyCode": codes.get(key, 0), "modifiers": 8 * shift}
        self._call("Input.dispatchKeyEvent", type="keyDown", key=key, **code, **text)
        self._call("Input.dispatchKeyEvent", type="keyUp", key=key, **code)

    def touch(self, *moves: list[tuple[float, float]]) -> None:
        """Touch the page with fingers, move them from places to places [pixels], and lift them."""
        for kind, places in zip(("touchStart", *["touchMove"] * len(moves)), [*moves], strict=False):
            points = [{"x": x, "y": y, "id": finger} for finger, (x, y) in enumerate(places)]
            self._call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        self._call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def memory(self) -> float:
        """Memory of the page's scripts after garbage collection [MB], with the arrays of its numbers."""
        for _ in range(3):  # some memory is given back by a later collection only
            self._call("HeapProfiler.collectGarbage")
            time.sleep(0.1)
        used = self._call("Runtime.getHeapUsage")
        return (used["usedSize"] + used.get("backingStorageSize", 0) + used.get("embedderHeapUsedSize", 0)) / 1e6

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._writer, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._count:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]
            self._note(answer)

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            part = os.read(self._reader, 1 << 20)
            if not part:
                raise RuntimeError("the browser has ended")
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(message)

    def _note(self, event: dict[str, Any]) -> None:
        content = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            self.errors.append(str(content["exceptionDetails"].get("exception", content)))
        elif event.get("method") == "Runtime.consoleAPICalled" and content["type"] == "error":
            self.errors.append(str(content["args"]))


@pytest.fixture(scope="module")
def browser_of_a_module():
    """The argument of tests, under the name that a module gives it."""
    with Browser() as browser:
        yield browser
