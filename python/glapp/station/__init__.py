"""The operator's window: the plant's valves in the browser.

It stands on the service: what is shown is read from its database, which is never written here, and commands go through
its API in the person's own name. Needs the extra `glapp[station]`.
"""
