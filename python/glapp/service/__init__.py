"""The plant's service: connection, store, commands."""
