"""Users of the service: names, roles, passwords and tokens."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import threading
from collections import Counter, deque
from contextlib import suppress
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerifyMismatchError

from ..errors import InputError
from .store import Store

__all__ = ["Attempt", "Person", "Role", "Tries", "Users", "first_user", "station_key"]

SHORTEST = 10
"""A password has at least this many characters."""

LOGIN_LASTS = 12 * 3600.0
"""A token is good for so long [s]."""

TRIES = 5
"""Wrong passwords of a name within `TRIES_WITHIN` that are allowed from all addresses from which it never logged in."""

TRIES_OF_ADDRESS = 10
"""Wrong passwords within that time that are allowed from an address from which nobody ever logged in, whatever the
names.
"""

TRIES_WITHIN = 300.0
"""[s]"""

PACE = 2.0
"""Beyond `TRIES`, the next password from an address that is known is looked at so long after the one before [s]."""

PLACES = 4096
"""Number of counters of names, and as many of addresses."""

ADDRESSES = 20
"""Number of newest addresses kept for a name that logged in from them."""


class Role(IntEnum):
    """Role of a person; each includes the rights of those before.

    - `VIEWER`: see everything.
    - `OPERATOR`: ask for a fit; switch compensation off.
    - `ENGINEER`: change a detector's parameters, take over a fit, enable compensation, manage users.
    """

    VIEWER = 1
    OPERATOR = 2
    ENGINEER = 3

    @classmethod
    def named(cls, name: str) -> Role:
        """The role of a name.

        Raises InputError where there is none of it.
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
    """Login refused: the sentence says no more than a stranger may know."""


@dataclass(eq=False, slots=True)
class Attempt:
    """A password that is about to be looked at, and counts already.

    - `name`, `address`: whose it is said to be, and where it comes from.
    - `known`: whether that name has logged in from there before.
    - `wait`: so long from now it is not looked at [s], at most `PACE`.
    - `displaced`: whether another one came meanwhile, which waits in its place.
    """

    name: str
    address: str
    known: bool
    wait: float = 0.0
    displaced: bool = False
    _counts: list[deque[float]] = field(default_factory=list)
    _at: float = 0.0

    def right(self) -> None:
        """The password is right: this try does not count, and earlier ones still do."""
        for one in self._counts:
            if self._at in one:
                one.remove(self._at)


class Tries:
    """Passwords that are tried, counted by name and by address apart, before any is looked at.

    A count has its place by a hash of the name or address with a key that nobody knows. There are as many places as
    there are, so that no number of names takes a count away; two that share a place share its count, which locks
    strangers out earlier and nobody who is known.

    - `known`: addresses from which each name has logged in, the newest last.

    Examples
    --------
    >>> tries = Tries()
    >>> for _ in range(TRIES):
    ...     _ = tries.attempt("eve", "10.0.0.7", 100.0)
    >>> tries.attempt("eve", "10.0.0.8", 100.0)
    Traceback (most recent call last):
    glapp.service.users.Refused: too many wrong passwords: wait 300 s
    >>> tries = Tries({"eve": ["10.0.0.8"]})
    >>> [tries.attempt("eve", "10.0.0.8", 100.0).wait for _ in range(TRIES + 2)][-3:]
    [0.0, 2.0, 2.0]
    """

    def __init__(self, known: dict[str, list[str]] | None = None) -> None:
        self.known = known or {}
        self._key = secrets.token_bytes(16)
        self._names: dict[int, deque[float]] = {}
        self._addresses: dict[int, deque[float]] = {}
        self._paced: dict[tuple[str, str], deque[float]] = {}
        self._waits: dict[tuple[str, str], Attempt] = {}

    def _count(self, counts: dict[int, deque[float]], what: str, most: int, now: float) -> deque[float]:
        """Wrong passwords of a name or an address within the time that counts."""
        digest = hashlib.blake2b(what.encode("utf-8", "replace"), digest_size=8, key=self._key).digest()
        found = counts.setdefault(int.from_bytes(digest, "big") % PLACES, deque())
        _forget(found, now)
        if len(found) >= most:
            raise Refused(f"too many wrong passwords: wait {TRIES_WITHIN - (now - found[0]):.0f} s")
        return found

    def attempt(self, name: str, address: str, now: float) -> Attempt:
        """Count a login that is tried, before its password is checked.

        - `name`, `address`: the name it gives, and the address that it comes from.
        - `now`: by a clock that never goes back [s].

        Raises Refused after too many wrong passwords.
        """
        if address in self.known.get(name, ()):
            return self._slowed(Attempt(name, address, True, _at=now), (name, address), now)
        of_name = self._count(self._names, name, TRIES, now)
        if any(address in one for one in self.known.values()):
            found = self._slowed(Attempt(name, address, False, _at=now), ("", address), now)
        else:
            of_address = self._count(self._addresses, address, TRIES_OF_ADDRESS, now)
            of_address.append(now)
            found = Attempt(name, address, False, _at=now, _counts=[of_address])
        of_name.append(now)
        found._counts.append(of_name)
        return found

    def _slowed(self, attempt: Attempt, key: tuple[str, str], now: float) -> Attempt:
        """Slow a login from a known address, never refuse it: after `TRIES` it waits, and a newer one displaces it."""
        starts = self._paced.setdefault(key, deque(maxlen=TRIES))
        _forget(starts, now)
        waiting = self._waits.get(key)
        if waiting is not None and waiting._at > now:
            waiting.displaced = True
            attempt._at = waiting._at
        else:
            attempt._at = max(now, starts[-1] + PACE) if len(starts) == TRIES else now
            starts.append(attempt._at)
        self._waits[key] = attempt
        attempt.wait = attempt._at - now
        attempt._counts.append(starts)
        return attempt

    def succeeded(self, attempt: Attempt) -> bool:
        """Take a name as known at its address; whether that is new."""
        attempt.right()
        addresses = self.known.setdefault(attempt.name, [])
        if addresses and addresses[-1] == attempt.address:
            return False
        self.known[attempt.name] = [one for one in addresses if one != attempt.address][1 - ADDRESSES :]
        self.known[attempt.name].append(attempt.address)
        there = {(name, address) for name, some in self.known.items() for address in some}
        there |= {("", address) for _, address in there}
        for kept in (self._paced, self._waits):
            for key in kept.keys() - there:
                del kept[key]
        return True


def _forget(times: deque[float], now: float) -> None:
    """Drop the times of logins that are too old to count."""
    while times and now - times[0] >= TRIES_WITHIN:
        times.popleft()


class Users:
    """The users in the database.

    - `store`: where they are.
    - `cost`: how passwords are hashed; Argon2id with the library's own costs where not given.
    """

    def __init__(self, store: Store, cost: PasswordHasher | None = None) -> None:
        self._store = store
        self._hasher = cost or PasswordHasher()
        self._nobody = self._hasher.hash(secrets.token_hex())
        self._writing = threading.Lock()
        self._counting = threading.Lock()  # held for no write, so that who counts a try waits for no disk
        self._names = {row["name"] for row in store.users()}
        self._tries = Tries(store.known_addresses())
        # Kept here and not only in the database: tokens are known though no disk answers.
        self._logins = {
            row["digest"]: (Person(row["name"], Role.named(row["role"])), row["expires"]) for row in store.logins()
        }

    def put(self, name: str, role: str, password: str | None, now: float) -> None:
        """Add a user, or change one; without a password it keeps its own. Who was logged in by that name is no longer.

        Raises InputError for a name, role or password that cannot be; where the last engineer would go.
        """
        if not name or len(name) > 64 or not name.isprintable() or name != name.strip():
            raise InputError(
                "must have 1 to 64 printable characters", parameter="name", value=name, bound="1 to 64 characters"
            )
        rank = Role.named(role)
        old = self._store.user(name)
        if password is None and old is None:
            raise InputError("is required for a new user", parameter="password", bound="required")
        if password is not None and not SHORTEST <= len(password) <= 1000:
            raise InputError(f"must have {SHORTEST} characters or more", parameter="password", bound=f">= {SHORTEST}")
        if old is not None and rank is not Role.ENGINEER:
            self._not_the_last(name)
        digest = old["password"] if password is None and old is not None else self._hasher.hash(password or "")
        with self._writing:
            self._store.put_user(name, role, digest, now)
            self._end(name)
            self._names.add(name)

    def remove(self, name: str) -> None:
        """Remove a user.

        Raises InputError where there is none of that name, or it is the last engineer.
        """
        self._not_the_last(name)
        with self._writing:
            if not self._store.remove_user(name):
                raise InputError("no such user", parameter="name", value=name)
            self._end(name)
            self._names.discard(name)
            with self._counting:
                self._tries.known.pop(name, None)

    def _end(self, name: str) -> None:
        """End the logins of a user."""
        self._logins = {digest: login for digest, login in self._logins.items() if login[0].name != name}

    def _not_the_last(self, name: str) -> None:
        """Refuse to remove the last engineer."""
        if [user["name"] for user in self._store.users() if user["role"] == "engineer"] == [name]:
            raise InputError("is the last engineer", parameter="name", value=name, hint="make another one first")

    def attempt(self, name: str, address: str, now: float) -> Attempt:
        """Count a password that somebody is about to try, before it is looked at.

        - `name`, `address`: whose it is said to be, and where it comes from.
        - `now`: by a clock that never goes back [s].

        Raises Refused where there were too many.
        """
        with self._counting:
            return self._tries.attempt(name, address, now)

    def log_in(self, attempt: Attempt, password: str, now: float) -> tuple[str, Person]:
        """A new token for a user, to be shown with every request.

        - `attempt`: what `attempt` counted.
        - `password`: the password.
        - `now`: the time [s since 1970 UTC].

        Raises Refused for a wrong name or password, with the same message.
        """
        known = self._store.user(attempt.name)
        try:
            self._hasher.verify(known["password"] if known else self._nobody, password)
        except (VerifyMismatchError, InvalidHashError):
            known = None
        token = secrets.token_urlsafe(32)
        with self._writing:
            if known is None or self._store.user(attempt.name) != known:  # it was changed meanwhile
                raise Refused("wrong name or password")
            person = Person(attempt.name, Role.named(known["role"]))
            if any(until <= now for _, until in self._logins.values()):
                self._store.end_logins(now)
            self._store.add_login(digest_of(token), person.name, now + LOGIN_LASTS)
            self._logins = {digest: login for digest, login in self._logins.items() if login[1] > now}
            self._logins[digest_of(token)] = person, now + LOGIN_LASTS
            with self._counting:
                addresses = dict(self._tries.known) if self._tries.succeeded(attempt) else None
            if addresses is not None:
                self._store.put_known_addresses(addresses)
        return token, person

    def log_out(self, token: str) -> None:
        """End the login of a token."""
        with self._writing:
            self._logins.pop(digest_of(token), None)
            self._store.end_login(digest_of(token))

    def of(self, token: str, now: float) -> Person | None:
        """Owner of a token; None where it has none, or none any longer."""
        found = self._logins.get(digest_of(token))
        return None if found is None or found[1] <= now else found[0]

    def __contains__(self, name: str) -> bool:
        """Whether there is such a user."""
        return name in self._names


class RefusedLogins:
    """Refused logins, counted: the reports on them grow with time, and not with their number.

    The first is reported at once, and those after it when `every` seconds have passed.

    - `every`: [s]
    """

    def __init__(self, every: float = TRIES_WITHIN) -> None:
        self.total = 0
        self.every = every
        self._names: Counter[str] = Counter()
        self._addresses: Counter[str] = Counter()

    def add(self, name: str | None, address: str) -> str | None:
        """Count one; gives the text to report now, None where it is reported later.

        - `name`: the user's; None where there is none of that name, which may be a password typed in the wrong place.
        - `address`: where it came from.
        """
        self.total += 1
        first = not self._names
        whose = "a name that is no user's" if name is None else name
        self._names[whose] += 1
        if len(self._addresses) < PLACES or address in self._addresses:
            self._addresses[address] += 1
        return f"a login was refused: as {whose}, from {address}" if first else None

    def since(self) -> str | None:
        """Events since the first that was reported, and no more; None where there are none."""
        names, addresses = self._names, self._addresses
        self._names, self._addresses = Counter(), Counter()
        if (count := names.total() - 1) <= 0:
            return None
        [(whose, most)] = names.most_common(1)
        [(address, _)] = addresses.most_common(1)
        of_all = f"{len(addresses)}{' or more' if len(addresses) == PLACES else ''}"
        return (
            f"{count} logins more were refused in {self.every:.0f} s: {len(names)} names, of all {count + 1} most "
            f"({most}) as {whose}; {of_all} addresses, most from {address}"
        )


def first_user(store: Store, now: float) -> None:
    """Make `engineer` where there is no user yet; its password is written to `first-login.txt` of the folder."""
    if store.users():
        return
    password = secrets.token_urlsafe(12)
    _written(store.folder / "first-login.txt", f"user engineer\npassword {password}\n")
    Users(store).put("engineer", "engineer", password, now)


def station_key(folder: Path) -> str:
    """Key by which the station shows that it is the station, when it says from where somebody logs in: `station-key`.

    Who may read the service's folder may read it; it is made where it is missing.
    """
    path = folder / "station-key"
    with suppress(OSError):
        if len(found := path.read_text(encoding="utf-8").strip()) >= 32:
            return found
    key = secrets.token_urlsafe(32)
    _written(path, key)
    return key


def is_station(folder_key: str, shown: str | None) -> bool:
    """Whether a key that was shown is the station's."""
    return shown is not None and hmac.compare_digest(folder_key.encode(), shown.encode())


def _written(path: Path, text: str) -> None:
    """A file that is its owner's to read."""
    path.unlink(missing_ok=True)
    path.touch(mode=0o600)
    path.write_text(text, encoding="utf-8")


def digest_of(token: str) -> str:
    """Digest of a token, as the database has it."""
    return hashlib.sha256(token.encode()).hexdigest()
