"""Work that takes long, in a process of its own: the monitor goes on, and nothing waits for ever."""

from __future__ import annotations

import asyncio
import faulthandler
import os
import time
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from ..errors import InputError

__all__ = ["apart"]

_SPAWN = get_context("spawn")


async def apart(what: Callable[..., Any], *words: Any, longest: float) -> Any:
    """Result of a function, computed in a process of its own that ends with us.

    - `what`: a function of a module.
    - `*words`: what it is given; must be picklable, as what it gives.
    - `longest`: how long it may take, > 0 [s]; then it is ended.

    Raises InputError: what it raised; where it took too long, or its process was ended.
    """
    receiver, sender = _SPAWN.Pipe(duplex=False)
    began = time.monotonic()
    process = _SPAWN.Process(target=_send, args=(sender, what, words, longest), daemon=True)
    process.start()
    sender.close()
    try:
        good, message = await asyncio.to_thread(receiver.recv)
    except EOFError:
        late = time.monotonic() - began >= longest
        raise InputError(
            f"it took more than {longest:g} s, and was ended" if late else "its process was ended"
        ) from None
    finally:
        process.kill()
        process.join()
    if not good:
        raise InputError(message)
    return message


def _send(to: Connection, what: Callable[..., Any], words: tuple[Any, ...], longest: float) -> None:
    """Send the result of a function, or its error, from the child."""
    with open(os.devnull, "w") as nowhere:  # noqa: PTH123 - only the number of an open file is used
        faulthandler.dump_traceback_later(longest, exit=True, file=nowhere)
        try:
            to.send((True, what(*words)))
        except InputError as error:
            to.send((False, str(error)))
        except Exception as error:  # it must not end the monitor
            to.send((False, f"{type(error).__name__}: {error}"))
        finally:
            faulthandler.cancel_dump_traceback_later()
