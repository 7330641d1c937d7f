"""``report.html``: one file that shows a result to a colleague, without a network.

``content.py`` gathers the numbers, ``rendering.py`` puts them, the script and plotly.js into the template.
"""
