"""The secrets of a server: the token of programs, the one-time token of the browser, and the sessions.

Every user of a machine can read the command lines of all processes. The browser is therefore started with a
token that works once and for a short time: it becomes a cookie, which no command line shows.
"""

from __future__ import annotations

import secrets
import time
from dataclasses import dataclass, field

from pareto_ltl.support.errors import ConfigError

LIFE = 120.0  # [s] of the one-time token
MAX_SESSIONS = 50  # cookies that are accepted; the oldest is forgotten
MISSING = (
    "the token is missing or wrong: open the first line that pareto-ltl printed, or send it as a Bearer token"
)
LATE = "this address worked for {life:.0f} s after the start: open the first line that pareto-ltl printed"
USED = (
    "this address works once and was used before. If it was not you, another user of this machine has read it"
    "{ended}. Open the first line that pareto-ltl printed"
)
ENDED = ", so its session was ended"


class RefusedError(ConfigError):
    """A token that begins no session; the text says why."""


@dataclass(slots=True)
class Sessions:
    """What is accepted from programs and browsers.

    Attributes
    ----------
    token : str
        Accepted in ``Authorization: Bearer`` and in the address of the page, until the server ends.
    cookie : str
        Name of the cookie. It has the port, as browsers send cookies to all ports of a host.
    once, until : str, float
        The one-time token ("" without one), and when it ends, as ``time.monotonic()`` [s].
    browser : str
        The session that the one-time token began ("": none): it ends if that token comes a second time.
    known : list of str
        The sessions, the oldest first.
    """

    token: str
    cookie: str
    once: str = ""
    until: float = 0.0
    browser: str = ""
    known: list[str] = field(default_factory=list)

    def one_time(self) -> str:
        """A new one-time token."""
        self.once, self.browser, self.until = secrets.token_urlsafe(24), "", time.monotonic() + LIFE
        return self.once

    def has_token(self, given: str) -> bool:
        """Whether ``given`` is the token of programs."""
        return _equal(given, self.token)

    def has_session(self, cookies: str) -> bool:
        """Whether a ``Cookie`` header has a session."""
        pairs = (part.strip().partition("=") for part in cookies.split(";"))
        given = [value for name, _, value in pairs if name == self.cookie]
        return any(_equal(one, known) for one in given for known in self.known)

    def begun(self, given: str) -> str:
        """The value of a new session for a token in the address of the page.

        Raises
        ------
        RefusedError
            For a wrong token, and for a one-time token that is too old or comes again. In that case two have
            it, of whom one is not the user: the session that it began ends.
        """
        if self.has_token(given):
            return self._added()
        if not self.once or not _equal(given, self.once):
            raise RefusedError(MISSING)
        late = time.monotonic() > self.until
        if not self.browser and not late:
            self.browser = self._added()
            return self.browser
        if not self.browser:
            raise RefusedError(LATE.format(life=LIFE))
        ended = not late and self.browser in self.known
        if ended:  # later, everybody who can read the command line of the browser could end its session
            self.known.remove(self.browser)
        raise RefusedError(USED.format(ended=ENDED if ended else ""))

    def set_cookie(self, session: str) -> str:
        """The ``Set-Cookie`` header of a session."""
        return f"{self.cookie}={session}; Path=/; HttpOnly; SameSite=Strict"

    def _added(self) -> str:
        self.known = [*self.known[1 - MAX_SESSIONS :], secrets.token_urlsafe(24)]
        return self.known[-1]


def _equal(given: str, known: str) -> bool:
    return secrets.compare_digest(given.encode(errors="replace"), known.encode())
