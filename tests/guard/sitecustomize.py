"""On ``PYTHONPATH``: every connection of a process and of its children is refused and noted in a file.

``PARETO_LTL_NOTES`` is the file. Sockets of the machine itself (AF_UNIX, socketpair) are not connections.
"""

import os
import socket
import sys


def refused(name):
    def refuse(self, address, *_):
        if self.family != getattr(socket, "AF_UNIX", None):
            with open(os.environ["PARETO_LTL_NOTES"], "a", encoding="utf-8") as notes:
                notes.write(f"{name} {address!r} by {' '.join(sys.argv)}\n")
            raise ConnectionRefusedError(f"{name} {address!r} in a test that allows no connection")
        return getattr(super(socket.socket, self), name)(address)

    return refuse


METHODS = {name: refused(name) for name in ("connect", "connect_ex", "bind")}


def look_up(host, *_, **__):
    """In place of ``getaddrinfo``, which sends questions about names."""
    with open(os.environ["PARETO_LTL_NOTES"], "a", encoding="utf-8") as notes:
        notes.write(f"getaddrinfo {host!r}\n")
    raise socket.gaierror("no name is looked up in a test that allows no connection")


if os.environ.get("PARETO_LTL_NOTES"):
    for name, method in METHODS.items():
        setattr(socket.socket, name, method)
    socket.getaddrinfo = look_up
