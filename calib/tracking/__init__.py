"""From a network and rays to targets, live: multiple-target tracking by continuous time and single rays.

A frame goes this way, and the files in this order:
- `targets`: the tracker; it predicts all targets to the frame's own time, also back for an out-of-sequence measurement;
- `filterbank`, `motion`: the Schmidt-Kalman filters of all targets and the process noise that manoeuvres ask for;
- `association`: data association: gating by Mahalanobis distance, then the assignment of least total cost;
- `track_scores`: what was seen and what was not, as a sequential probability ratio test: track confirmation, deletion;
- `tracklets`, `initiation`: what was associated with none, gathered per camera; where tracks of two cameras meet,
  a tentative target begins;
- `pixelbias`: errors of pixels that last, as part of the poses' covariance; `options`: the limits of all this.
"""
