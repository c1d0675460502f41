"""Font and colours of all figures."""

FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'
INK, MUTED, GRID, PAPER = "#1f2933", "#5a6673", "#e3e7eb", "#ffffff"
RAW, SIGNAL, OUTPUT, POSITION, POINT = "#a9c3de", "#1d5b9c", "#6d4795", "#b8651b", "#00875f"
TOO_WIDE, UNJUDGED = "#c4501b", "#3f74a8"
