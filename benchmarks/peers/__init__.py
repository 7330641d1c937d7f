"""Our planner and logic beside OMPL, Drake and MONA: same scenes, same machine, same process tree.

make peers

Each peer has its own environment (``requirements-PEER.txt``); a peer that is not installed is left out.
"""
