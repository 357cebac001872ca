"""Processes of ROS that tests drive by their standard streams."""

import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from subprocess import DEVNULL, PIPE, STDOUT, Popen, TimeoutExpired
from threading import Condition, Thread
from typing import Any, Self

ROOT = Path(__file__).parents[2]
PATIENCE_S = 20.0
ENDS_WITHIN_S = 5.0
ENVIRONMENT = {
    **os.environ,
    "PYTHONPATH": str(ROOT),
    "PYTHONUNBUFFERED": "1",
    # Without sockets: those of Fast DDS listen on all interfaces in any case. Twice so many bytes are shared.
    "FASTDDS_BUILTIN_TRANSPORTS": "SHM?sockets_size=16MB",
    "ROS_DOMAIN_ID": str(1 + os.getpid() % 200),
    "ROS_LOG_DIR": tempfile.gettempdir(),
}
"""Variables of every process: a domain that is ours alone, and shared memory in place of a network."""


class Process:
    """A program whose output is kept, line by line; as a context, it does not outlive its block.

    Args:
        arguments: What follows the interpreter.
        is_driven: Whether it reads its standard input.
    """

    def __init__(self, *arguments: str, is_driven: bool = False) -> None:
        streams: dict[str, Any] = {"stdin": PIPE if is_driven else DEVNULL, "stdout": PIPE, "stderr": STDOUT}
        self.process = Popen([sys.executable, *arguments], **streams, text=True, env=ENVIRONMENT, cwd=ROOT)
        self.lines: list[str] = []
        self._changed = Condition()
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._changed:
                self.lines.append(line.rstrip("\n"))
                self._changed.notify_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    def wait_for(self, is_there: Callable[[list[str]], Any], timeout_s: float = PATIENCE_S) -> Any:
        """What a function makes of all lines, as soon as that is true; if never, an `AssertionError` shows them."""
        with self._changed:
            if not self._changed.wait_for(lambda: is_there(self.lines), timeout_s):
                raise AssertionError(f"not told within {timeout_s} s; what was told:\n{self.text[-3000:]}")
            return is_there(self.lines)

    def wait_for_text(self, text: str, timeout_s: float = PATIENCE_S) -> str:
        """The first line with a text."""
        return str(self.wait_for(lambda lines: next((line for line in lines if text in line), ""), timeout_s))

    def end(self, number: int = signal.SIGINT, timeout_s: float = PATIENCE_S) -> int:
        """Send a signal, and return the exit code."""
        self.process.send_signal(number)
        return self.ended(timeout_s)

    def ended(self, timeout_s: float = PATIENCE_S) -> int:
        """The exit code, once it has ended and all is read."""
        code = self.process.wait(timeout_s)
        self._reader.join()
        for stream in filter(None, (self.process.stdin, self.process.stdout)):
            stream.close()
        return code

    def close(self) -> None:
        """End it as it wants to be ended, so that it leaves no shared memory, or else at once."""
        self.ask_to_end()
        try:
            self.ended(ENDS_WITHIN_S)
        except TimeoutExpired:
            self.kill()

    def ask_to_end(self) -> None:
        self.process.send_signal(signal.SIGINT)

    def kill(self) -> None:
        """Let it die."""
        self.process.kill()
        self.ended()


class Peer(Process):
    """A module of these tests that takes requests in lines of JSON, and answers so."""

    def __init__(self, module: str) -> None:
        super().__init__("-m", f"tests.ros.{module}", is_driven=True)
        try:
            self.wait_for_text('"ready"')
        except AssertionError:
            self.kill()
            raise

    def ask_to_end(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()

    def ask(self, **request: Any) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()

    def request(self, answer: str, **values: Any) -> Any:
        """Ask, and return the next answer with a key."""
        n = len(self.messages(answer))
        self.ask(**values)
        return self.wait_for(lambda _: self.messages(answer)[n:])[0][answer]

    def messages(self, key: str) -> list[dict[str, Any]]:
        """What was reported with a key."""
        return [message for line in list(self.lines) if line.startswith("{") and key in (message := json.loads(line))]

    def received(self, topic: str) -> list[dict[str, Any]]:
        """The messages of a topic."""
        return [message for message in self.messages("topic") if message["topic"] == topic]


def node_process(namespace: str, *arguments: str, **parameters: Any) -> Process:
    """The node, with parameters; it is made in a namespace."""
    given = [part for name, value in parameters.items() for part in ("-p", f"{name}:={value}")]
    return Process("-m", "voxdepth_ros", "--ros-args", "-r", f"__ns:={namespace}", *given, *arguments)


def listening(pid: int) -> list[str]:
    """The addresses of sockets of the internet that a process has open."""
    folder, own = Path(f"/proc/{pid}"), set()
    for each in (folder / "fd").iterdir():
        with suppress(FileNotFoundError):
            own.add(str(each.readlink()))
    tables: Mapping[str, list[str]] = {
        kind: (folder / "net" / kind).read_text().splitlines()[1:] for kind in ("tcp", "udp", "tcp6", "udp6")
    }
    rows = [(kind, line.split()) for kind, lines in tables.items() for line in lines]
    return [f"{kind} {row[1]}" for kind, row in rows if f"socket:[{row[9]}]" in own]


def wait_until(is_so: Callable[[], Any], timeout_s: float = PATIENCE_S) -> Any:
    """Wait for a condition that no process tells."""
    until_s = time.monotonic() + timeout_s
    while not (found := is_so()):
        assert time.monotonic() < until_s
        time.sleep(0.05)
    return found
