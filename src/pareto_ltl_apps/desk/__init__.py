"""The planning desk: a server on the loopback address, its API, and its page (docs/desk.md).

``app`` has the routes, ``server`` refuses requests of other pages and machines, ``folder`` is the only place
that is read and written, ``plans`` runs command lines in a ``worker`` process, ``views`` and ``missions`` are
what the API answers.
"""
