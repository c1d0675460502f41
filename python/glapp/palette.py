"""Font, colours and smallest axis of all figures."""

FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'
INK, MUTED, GRID, PAPER = "#1f2933", "#5a6673", "#e3e7eb", "#ffffff"
RAW, SIGNAL, OUTPUT, POSITION, POINT = "#a9c3de", "#1d5b9c", "#6d4795", "#b8651b", "#00875f"
TOO_WIDE, UNJUDGED = "#c4501b", "#3f74a8"

FLAT = 0.01
"""The axis of a signal that does not move goes this share of its value to either side, and by 1 where it is 0."""
