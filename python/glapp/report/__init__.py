"""What a person reads: the words, the figures and the HTML report of a run.

`words` turns a result into sentences, `figures` into Plotly figures, `html` into one file that needs nothing else.
"""

from glapp.report.figures import loop_figure, overview_figure, phase_figure
from glapp.report.html import write_report

__all__ = ["loop_figure", "overview_figure", "phase_figure", "write_report"]
