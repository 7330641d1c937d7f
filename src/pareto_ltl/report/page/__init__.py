"""``report.html``: one file that shows a result to a colleague, without a network.

``content.py`` gathers the numbers, ``rendering.py`` puts them, the scripts and the style into the template.
"""
