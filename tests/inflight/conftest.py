from __future__ import annotations

import socket

import pytest


@pytest.fixture
def free_port() -> int:
    """A UDP port of the loopback that is free."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])
