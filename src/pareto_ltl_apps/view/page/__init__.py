"""``report.html``: one file that shows a result to a colleague, without a network.

``content.py`` gathers the numbers, and puts them, the scripts and the style into the template.
"""
