"""An OPC UA server begins with six thousand nodes of the standard: for all servers of the tests they are made once.

What is kept is each node as asyncua made it; a server takes its own copy of one when it first looks at it.
"""

import asyncio
import pickle
from typing import Any

from asyncua.server.internal_server import InternalServer
from fits import kept

make = InternalServer.load_standard_address_space


class Nodes(dict[Any, Any]):
    """Nodes by their identifiers, of which those that nobody has looked at are bytes."""

    def __getitem__(self, key: Any) -> Any:
        node = super().__getitem__(key)
        if isinstance(node, bytes):
            node = self[key] = pickle.loads(node)
        return node

    def get(self, key: Any, default: Any = None) -> Any:
        try:
            return self[key]
        except KeyError:
            return default


def remember() -> None:
    """Keep the nodes of this process from here on."""
    known: dict[Any, bytes] = {}

    async def load(server: InternalServer, shelf_file: None = None) -> None:
        if not known:
            known.update(await asyncio.to_thread(kept, "nodes of the standard", as_bytes))
        server.aspace._nodes = Nodes(known)

    InternalServer.load_standard_address_space = load


def as_bytes() -> dict[Any, bytes]:
    """Every node as asyncua makes it."""
    server = InternalServer()
    asyncio.run(make(server))
    return {key: pickle.dumps(node, protocol=5) for key, node in server.aspace._nodes.items()}
