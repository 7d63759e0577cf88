"""A browser without a window, for tests of pages: Debian's chromium, told what to do by its DevTools protocol."""

import asyncio
import base64
import io
import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Coroutine
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from matplotlib.image import imread
from tornado.websocket import WebSocketClientConnection, websocket_connect

CHROMIUM = shutil.which("chromium")
_FLAGS = (
    "--headless=new --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --hide-scrollbars "
    "--no-first-run --disable-background-networking --disable-dev-shm-usage --remote-debugging-port=0"
)
_READY = "document.documentElement?.dataset.ready === 'yes'"
_PATIENCE = 90.0  # s for anything

Result = TypeVar("Result")


class Browser:
    """A page at a time, and what went wrong on it.

    Attributes:
        errors: what the page wrote on its console as errors, and what it threw.
        requests: addresses that it asked for, but for its own file and data.
    """

    def __init__(self) -> None:
        assert CHROMIUM is not None
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        command = [CHROMIUM, *_FLAGS.split(), f"--user-data-dir={self._folder.name}", "about:blank"]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self._loop = asyncio.new_event_loop()
        self._number, self._session = 0, ""
        self._connection: WebSocketClientConnection = self._wait(self._connect())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()
        self._loop.run_until_complete(asyncio.sleep(0.05))
        self._loop.close()
        self._process.terminate()
        self._process.communicate(timeout=30)
        self._folder.cleanup()

    def open(self, path: Path, width: int = 1400, height: int = 900, theme: str = "light") -> None:
        """Loads a page of ours, and waits until it is ready."""
        self.errors.clear()
        self.requests.clear()
        if not self._session:
            target = self.tell("Target.createTarget", url="about:blank")["targetId"]
            self._session = self.tell("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            for domain in ("Page", "Runtime", "Log", "Network"):
                self.tell(f"{domain}.enable")
        self.tell("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.tell("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])
        self.tell("Page.navigate", url=path.absolute().as_uri())
        self.wait_for(_READY)

    def evaluate(self, script: str) -> Any:
        """The value of an expression in the page."""
        found = self.tell("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait_for(self, script: str) -> None:
        """Waits until an expression is true."""
        for _ in range(int(_PATIENCE / 0.1)):
            if self.evaluate(script):
                return
            self._loop.run_until_complete(asyncio.sleep(0.1))
        raise TimeoutError(f"{script} did not become true; errors: {self.errors}")

    def screenshot(self) -> np.ndarray:
        """What is seen, once it is drawn, shape (height, width, 3), 0 to 1."""
        self.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
        data = self.tell("Page.captureScreenshot", format="png")["data"]
        return imread(io.BytesIO(base64.b64decode(data)))[..., :3]

    def tell(self, method: str, **params: Any) -> dict[str, Any]:
        """Sends a command, and waits for its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        return self._wait(self._exchange(message))

    async def _exchange(self, message: dict[str, Any]) -> dict[str, Any]:
        await self._connection.write_message(json.dumps(message))
        while True:
            text = await self._connection.read_message()
            assert text is not None, "the browser has ended"
            answer = json.loads(text)
            if answer.get("id") == message["id"]:
                assert "error" not in answer, answer["error"]
                result: dict[str, Any] = answer["result"]
                return result
            self._note(answer.get("method", ""), answer.get("params", {}))

    def _note(self, method: str, params: dict[str, Any]) -> None:
        if method == "Runtime.exceptionThrown":
            self.errors.append(str(params["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "assert"):
            self.errors.append(str(params["args"]))
        elif method == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(str(params["entry"]))
        elif method == "Network.requestWillBeSent":
            url = params["request"]["url"]
            if not url.startswith(("data:", "blob:", "file:", "about:")):
                self.requests.append(url)

    async def _connect(self) -> WebSocketClientConnection:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            found = re.search(r"DevTools listening on (ws://\S+)", line)
            if found:
                return await websocket_connect(found[1], max_message_size=1 << 28)
        raise RuntimeError("chromium does not start")

    def _wait(self, coroutine: Coroutine[Any, Any, Result]) -> Result:
        return self._loop.run_until_complete(asyncio.wait_for(coroutine, _PATIENCE))
