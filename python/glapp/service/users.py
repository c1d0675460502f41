"""Who may ask the service for what: users, roles, passwords and the tokens that stand for them."""

from __future__ import annotations

import hashlib
import secrets
from dataclasses import dataclass
from enum import IntEnum

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerifyMismatchError

from ..errors import InputError
from .memory import Memory, Reader

__all__ = ["Person", "Role", "Users", "first_user"]

SHORTEST = 10
"""A password has at least so many characters."""

LOGIN_LASTS = 12 * 3600.0
"""A token is good for so long [s]."""

TRIES = 5
"""So many wrong passwords of a name within `TRIES_WITHIN`; then it waits."""

TRIES_WITHIN = 300.0
"""[s]"""


class Role(IntEnum):
    """What a person may do; each may what those before may.

    Attributes
    ----------
    VIEWER
        See everything.
    OPERATOR
        Ask for a fit; switch compensation off.
    ENGINEER
        Change a detector's parameters, take over a fit, enable compensation, manage users.
    """

    VIEWER = 1
    OPERATOR = 2
    ENGINEER = 3

    @classmethod
    def named(cls, name: str) -> Role:
        """The role of a name.

        Raises
        ------
        InputError
            Where there is none of it.
        """
        for role in cls:
            if role.name.lower() == name:
                return role
        raise InputError(
            f"is {name!r}, must be viewer, operator or engineer", parameter="role", value=name, bound="a role"
        )


@dataclass(frozen=True, slots=True)
class Person:
    """Somebody who has logged in."""

    name: str
    role: Role


class Refused(Exception):  # noqa: N818 - a refusal is an answer, not a fault of the program
    """Nobody was logged in: the sentence says no more than a stranger may know."""


class Users:
    """The users in the database.

    Parameters
    ----------
    memory : Memory
        Where they are.
    cost : PasswordHasher, optional
        How passwords are hashed; Argon2id with the library's own costs where not given.
    """

    def __init__(self, memory: Memory, cost: PasswordHasher | None = None) -> None:
        self._memory = memory
        self._hasher = cost or PasswordHasher()
        self._nobody = self._hasher.hash(secrets.token_hex())
        self._failed: dict[str, list[float]] = {}

    def put(self, name: str, role: str, password: str | None, now: float) -> None:
        """Add a user, or change one; without a password it keeps its own. Who was logged in by that name is no longer.

        Raises
        ------
        InputError
            For a name, role or password that cannot be; where the last engineer would go.
        """
        if not name or len(name) > 64 or not name.isprintable() or name != name.strip():
            raise InputError(
                "must have 1 to 64 printable characters", parameter="name", value=name, bound="1 to 64 characters"
            )
        rank = Role.named(role)
        old = self._memory.one("SELECT role, password FROM users WHERE name = ?", name)
        if password is None and old is None:
            raise InputError("is required for a new user", parameter="password", bound="required")
        if password is not None and not SHORTEST <= len(password) <= 1000:
            raise InputError(f"must have {SHORTEST} characters or more", parameter="password", bound=f">= {SHORTEST}")
        if old is not None and rank is not Role.ENGINEER:
            self._not_the_last(name)
        digest = old["password"] if password is None and old is not None else self._hasher.hash(password or "")
        self._memory.write("INSERT OR REPLACE INTO users VALUES (?, ?, ?, ?)", name, role, digest, now)
        self._memory.write("DELETE FROM tokens WHERE person = ?", name)

    def remove(self, name: str) -> None:
        """Take a user out.

        Raises
        ------
        InputError
            Where there is none of that name, or it is the last engineer.
        """
        self._not_the_last(name)
        if not self._memory.write("DELETE FROM users WHERE name = ?", name):
            raise InputError("no such user", parameter="name", value=name)

    def _not_the_last(self, name: str) -> None:
        others = self._memory.one("SELECT 1 FROM users WHERE role = 'engineer' AND name <> ?", name)
        own = self._memory.one("SELECT 1 FROM users WHERE role = 'engineer' AND name = ?", name)
        if own and not others:
            raise InputError("is the last engineer", parameter="name", value=name, hint="make another one first")

    def log_in(self, name: str, password: str, now: float) -> tuple[str, Person]:
        """A new token for a user, to be shown with every request.

        Raises
        ------
        Refused
            For a wrong name or password, which are not told apart, and where there were too many of them.
        """
        failed = [at for at in self._failed.get(name, []) if now - at < TRIES_WITHIN]
        if len(failed) >= TRIES:
            raise Refused(f"too many wrong passwords: wait {TRIES_WITHIN - (now - failed[0]):.0f} s")
        known = self._memory.one("SELECT role, password FROM users WHERE name = ?", name)
        try:
            self._hasher.verify(known["password"] if known else self._nobody, password)
        except (VerifyMismatchError, InvalidHashError):
            known = None
        if known is None:
            if len(self._failed) > 1000:
                self._failed.clear()
            self._failed[name] = [*failed, now]
            raise Refused("wrong name or password")
        self._failed.pop(name, None)
        token = secrets.token_urlsafe(32)
        self._memory.write("DELETE FROM tokens WHERE expires < ?", now)
        self._memory.write("INSERT INTO tokens VALUES (?, ?, ?)", _digest(token), name, now + LOGIN_LASTS)
        return token, Person(name, Role.named(known["role"]))

    def log_out(self, token: str) -> None:
        """The token is good for nothing any more."""
        self._memory.write("DELETE FROM tokens WHERE digest = ?", _digest(token))

    def of(self, token: str, now: float) -> Person | None:
        """Who a token stands for; None where it does not, or no longer."""
        found = self._memory.one(
            "SELECT name, role FROM tokens JOIN users ON name = person WHERE digest = ? AND expires > ?",
            *(_digest(token), now),
        )
        return None if found is None else Person(found["name"], Role.named(found["role"]))


def listed(memory: Reader) -> list[dict[str, str]]:
    """Name and role of every user."""
    return memory.rows("SELECT name, role FROM users ORDER BY name")


def first_user(memory: Memory, now: float) -> None:
    """Where there is no user yet, make `engineer`, with a password that stands in `first-login.txt` of the folder."""
    if listed(memory):
        return
    password = secrets.token_urlsafe(12)
    path = memory.folder / "first-login.txt"
    path.unlink(missing_ok=True)
    path.touch(mode=0o600)
    path.write_text(f"user engineer\npassword {password}\n", encoding="utf-8")
    Users(memory).put("engineer", "engineer", password, now)


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
