"""The plant's service: connection, memory, commands."""
