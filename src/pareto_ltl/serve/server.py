"""The server: a free port of the loopback address, and a new token for each start."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable
from pathlib import Path

import uvicorn

from pareto_ltl.serve.app import desk_app
from pareto_ltl.serve.folder import DeskFolder
from pareto_ltl.support.errors import ConfigError

ADDRESS = "127.0.0.1"
GRACE = 2  # [s] for open streams when the server ends


def serve_desk(folder: Path, port: int, opened: Callable[[str], None]) -> None:
    """Serve ``folder`` until a signal; ``opened`` gets the address with the token before the first request.

    Raises
    ------
    ConfigError
        If the port is taken.
    """
    kept, token = DeskFolder.opened(folder), secrets.token_urlsafe(24)
    with socket.socket() as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((ADDRESS, port))
        except OSError as error:
            raise ConfigError(
                f"port {port} of {ADDRESS} is not free ({error.strerror}); use --port 0"
            ) from None
        listening.listen()
        number = listening.getsockname()[1]
        config = uvicorn.Config(
            desk_app(kept, token, number), log_level="warning", access_log=False, server_header=False,
            lifespan="on", timeout_graceful_shutdown=GRACE, ws="none",
        )  # fmt: skip
        opened(f"http://{ADDRESS}:{number}/?token={token}")
        uvicorn.Server(config).run(sockets=[listening])
