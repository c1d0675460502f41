"""Output for a person: the words, the figures and the HTML report of a run.

`words` turns a result into sentences, `figures` into Plotly figures, `html` into one file that needs nothing else.
Import what you need from them: `words` alone costs nothing, the others import Plotly.
"""
