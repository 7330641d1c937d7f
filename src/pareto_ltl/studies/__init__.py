"""The paper's evaluation and more, as pipelines: who fails how often, how fast it gets better, what matters.

``compare`` sets planners side by side in the same winds, ``convergence`` watches trees grow, ``ablation``
changes one setting at a time, ``hindcast`` flies plans through winds that no model drew. Each is a list of
independent parts (a method and a seed, say), spread over processes and kept on disk as they finish
(``parts.py``), so that a run that was stopped goes on where it was.
"""
