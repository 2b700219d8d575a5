"""From recorded tracks to a network: one calibration, step by step. `solve` calls the steps in this order:

1. `inputs` the scene sorted out: which cameras and tracks are fit to work on (`series`: tracks as functions of time);
2. `common_time` all stamps near the site's time: `clock_correlation` and `clocks` where a pair's clocks may be, by
   epipolar geometry; `clock_consensus` what closes loops; `site_clocks` whose clock is known, and from what;
   `clock_steps` and `steadied` clocks that do not run evenly;
   `initial_estimate` cameras roughly right: the `scaffold` of a pair's relative pose and resections into it,
   `identity`: data association of whole tracks; `bootstrap`: georeference by a similarity, and the flight's first
   control points by triangulation;
3. `refine` the bundle adjustment (calib.adjustment), cameras that do not belong taken out, and what is claimed of the
   site but cannot be believed less: `strain` weighs the `doubts`, `rivals` tells them apart;
4. `readmit` what was left out, resected into the adjusted flight, and adjusted again with the others;
5. `solution` network, trajectory and covariances; `evidence` held-out residuals; `findings` what the user must know.

Beside them: `continuity` (a new network in the time of the one before), `prediction` (accuracy of a planned network).
"""
