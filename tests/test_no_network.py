"""bushseg opens no network connection: every command's work, in a process that would die of one."""

import subprocess
import sys
from pathlib import Path

import pytest
import tomli_w

GUARD = """
import os, sys

FORBIDDEN = (
    "socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg", "socket.getaddrinfo",
    "socket.gethostbyname", "socket.gethostbyaddr", "socket.getnameinfo", "urllib.Request",
    "http.client.connect", "ftplib.connect", "smtplib.connect",
)

def is_probe(event):
    # laspy imports requests where it is installed, whose urllib3 binds a socket to ::1 for a
    # moment, to learn whether there is IPv6. It neither listens nor connects.
    frame = sys._getframe(2)
    return event == "socket.bind" and frame.f_code.co_name == "_has_ipv6"

def watch(event, arguments):
    if event in FORBIDDEN and not is_probe(event):
        os.write(2, f"NETWORK {event} {arguments}".encode())
        os._exit(99)

sys.addaudithook(watch)
"""

WORK = """
import tomllib
from pathlib import Path

import bushseg
from bushseg.config import Config

scans, folder = Path(sys.argv[1]), Path(sys.argv[2])
config = Config.from_dict(tomllib.loads((folder / "config.toml").read_text()))
scan = folder / "scan.laz"
bushseg.prepare([scans], folder / "data", config.prepare)
bushseg.train(folder / "data", folder / "run", config)
bushseg.predict_file(scans / "south.las", scan, folder / "run" / "best.safetensors")
bushseg.evaluate(scan, scans / "south.las", bushseg.load_scheme("bush"))
assert bushseg.describe(scan).error is None
points = bushseg.read(scan)
bushseg.predict(points, folder / "run" / "best.safetensors")
"""


def run(code: str, *arguments: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", GUARD + code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=600)


def test_prepare_train_predict_evaluate_and_info_are_silent(scans, tiny, tmp_path):
    config = tiny(epochs=1, steps_per_epoch=2).model_dump(mode="json", exclude_none=True)
    (tmp_path / "config.toml").write_text(tomli_w.dumps(config))
    result = run(WORK, scans, tmp_path)
    assert result.returncode == 0, result.stderr
    assert "NETWORK" not in result.stderr


@pytest.mark.parametrize(
    "code",
    [
        "import socket; socket.socket().connect(('127.0.0.1', 9))",
        "import socket; socket.socket().bind(('127.0.0.1', 0))",
        "import socket; socket.getaddrinfo('localhost', 80)",
        "import urllib.request; urllib.request.urlopen('http://127.0.0.1:9')",
    ],
)
def test_the_guard_would_notice(code):
    result = run(code)
    assert result.returncode == 99
    assert "NETWORK" in result.stderr
