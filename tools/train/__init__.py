"""Train the detector that edge-node ships: `python -m tools.train --help`.

The hazard is that a detector learns its training clips instead of small flying things. So what it sees is made
afresh for every sample: real patches at random scales, real cut-outs and drawn silhouettes set on other backgrounds
at exact sub-pixel places and speeds, with noise and compression of their own. Test clips are never opened here.
"""
