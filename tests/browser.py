"""A headless Chromium, spoken to over a pipe, so that what it fetches and complains of is known."""

import fcntl
import json
import os
import select
import shutil
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

NAMES = ("chromium", "google-chrome", "google-chrome-stable")
WAIT_S = 60.0


@dataclass
class Visit:
    """What happened while a page was open.

    Attributes:
        requests: Addresses asked for, the page's own first; `data:` addresses cut off after it.
        blocked: Those of them that the page's own policy held back.
        complaints: Errors, warnings and dialogues.
    """

    requests: list[str] = field(default_factory=list)
    blocked: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)


def find_browser() -> str | None:
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """One tab, opened on entry and closed with its process on exit.

    Args:
        program: Chromium or Chrome.
        folder: Empty folder for its profile.
    """

    def __init__(self, program: str, folder: Path) -> None:
        self._program, self._folder = program, folder
        self._unread = b""
        self._last = 0
        self._visit = Visit()
        self._addresses: dict[str, str] = {}
        self._loaded = False

    def __enter__(self) -> "Browser":
        ours_in, theirs_out = os.pipe()
        theirs_in, ours_out = os.pipe()
        # The browser reads from 3 and writes to 4; ends above 10 cannot be in the way of these.
        reads, writes = (fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (theirs_in, theirs_out))

        def place() -> None:
            os.dup2(reads, 3)
            os.dup2(writes, 4)

        self._process = subprocess.Popen(
            [
                self._program, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
                "--disable-background-networking", "--disable-component-update",
                "--disable-sync", "--disable-dev-shm-usage", "--hide-scrollbars",
                "--remote-debugging-pipe", f"--user-data-dir={self._folder}",
            ],
            preexec_fn=place, pass_fds=(3, 4),
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        for end in (theirs_in, theirs_out, reads, writes):
            os.close(end)
        self._in, self._out = ours_in, ours_out
        self._session: str | None = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Network", "Log", "Runtime", "Page"):
            self.call(f"{domain}.enable")
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._in)
        os.close(self._out)

    def visit(self, address: str, width_px: int = 1200) -> Visit:
        """Open a page, wait until it and what it asks for is loaded, and a moment more."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width_px, height=900, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        self._visit, self._loaded = Visit(), False
        self.call("Page.navigate", url=address)
        end = time.monotonic() + WAIT_S
        while not self._loaded:
            self._handle(self._receive(end))
        self.evaluate("new Promise(done => setTimeout(done, 100))")
        return self._visit

    def evaluate(self, script: str) -> Any:
        """Value of an expression inside the page; a promise is waited for."""
        answer = self.call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._last += 1
        message: dict[str, Any] = {"id": self._last, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + WAIT_S
        while True:
            answer = self._receive(end)
            if answer.get("id") == self._last:
                assert "error" not in answer, answer
                result: dict[str, Any] = answer["result"]
                return result
            self._handle(answer)

    def _receive(self, end: float) -> dict[str, Any]:
        while b"\0" not in self._unread:
            ready, _, _ = select.select([self._in], [], [], max(end - time.monotonic(), 0.0))
            assert ready, f"{self._program} has not answered for {WAIT_S} s"
            piece = os.read(self._in, 1 << 20)
            assert piece, f"{self._program} has ended"
            self._unread += piece
        message, _, self._unread = self._unread.partition(b"\0")
        received: dict[str, Any] = json.loads(message)
        return received

    def _handle(self, event: dict[str, Any]) -> None:
        method, parameters = event.get("method"), event.get("params", {})
        if method == "Page.loadEventFired":
            self._loaded = True
        elif method == "Network.requestWillBeSent":
            address = parameters["request"]["url"]
            address = "data:" if address.startswith("data:") else address
            self._visit.requests.append(address)
            self._addresses[parameters["requestId"]] = address
        elif method == "Network.loadingFailed":
            if parameters.get("blockedReason") == "csp":
                self._visit.blocked.append(self._addresses[parameters["requestId"]])
        elif method == "Log.entryAdded":
            self._visit.complaints.append(parameters["entry"]["text"])
        elif method == "Runtime.consoleAPICalled":
            self._visit.complaints.append(str(parameters["args"]))
        elif method == "Runtime.exceptionThrown":
            self._visit.complaints.append(str(parameters["exceptionDetails"]))
        elif method == "Page.javascriptDialogOpening":
            self._visit.complaints.append(f"dialogue: {parameters['message']}")
            self._last += 1
            answer = {
                "id": self._last, "method": "Page.handleJavaScriptDialog",
                "params": {"accept": True}, "sessionId": self._session,
            }  # fmt: skip
            os.write(self._out, json.dumps(answer).encode() + b"\0")
