"""A browser without a window, controlled through its debugging pipe, that takes screenshots."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import shutil
import subprocess
from typing import TYPE_CHECKING, Any, Self

import pytest

from support.tools import tool_named

if TYPE_CHECKING:
    from pathlib import Path

(_NAMES,) = tool_named("chromium").programs
_FLAGS = (
    *("--headless=new", "--no-first-run", "--remote-debugging-pipe", "about:blank"),
    # Tests may run as root and without a graphics card: WebGL is drawn in software.
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)


def find_browser() -> str:
    """Return the browser's path; the test must have the mark ``needs("chromium")``."""
    for name in _NAMES:
        path = shutil.which(name)
        if path is not None:
            return path
    pytest.fail("chromium is missing, and the test lacks its mark `needs`")


class Browser:
    """One page with a size in pixels."""

    def __init__(self, folder: Path, page: str, size: tuple[int, int]) -> None:
        to_read, self._to = os.pipe()
        self._from, from_write = os.pipe()
        # The browser reads commands from file descriptor 3 and writes answers to 4.
        shell = f'exec "$@" 3<&{to_read} 4>&{from_write}'
        data = f"--user-data-dir={folder}"
        self._process = subprocess.Popen(
            ["/bin/bash", "-c", shell, "bash", find_browser(), data, *_FLAGS],
            pass_fds=(to_read, from_write),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(from_write)
        self._count, self._held = 0, b""
        self._session = ""
        target = self._call("Target.createTarget", url=page)["targetId"]
        attached = self._call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
        self._call("Emulation.setDeviceMetricsOverride", **metrics)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session = ""
        with contextlib.suppress(OSError, EOFError):
            self._call("Browser.close")
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._to)
        os.close(self._from)

    def screenshot(self, png: Path) -> None:
        """Write a picture of the page."""
        data = self._call("Page.captureScreenshot", format="png")["data"]
        png.write_bytes(base64.b64decode(data))

    def _call(self, method: str, **parameters: object) -> dict[str, Any]:
        self._count += 1
        command: dict[str, object] = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            command["sessionId"] = self._session
        os.write(self._to, json.dumps(command).encode() + b"\0")
        while True:
            while b"\0" not in self._held:
                got = os.read(self._from, 1 << 16)
                if not got:
                    raise EOFError("the browser ended")
                self._held += got
            text, _, self._held = self._held.partition(b"\0")
            answer = json.loads(text)
            if answer.get("id") == self._count:
                assert "error" not in answer, answer["error"]
                found: dict[str, Any] = answer["result"]
                return found
