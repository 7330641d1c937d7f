"""Our planner and logic beside OMPL, Drake and MONA: same scenes, same machine, same process tree.

make peers

Each peer has an environment of its own (``requirements-PEER.txt``); one that is missing is left out.
"""
