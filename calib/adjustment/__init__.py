"""The bundle adjustment: cameras and flight estimated together by nonlinear least squares, in continuous time.

`bundle` walks (Gauss-Newton, damped after Levenberg and Marquardt); `projection` gives residuals and their Jacobian,
`priors` what is known beforehand and holds the gauge, `smoothness` the flight's process noise, `noise` the robust loss,
`normal` the normal equations by their Schur complement, `weights` the variances, estimated from the residuals;
`uncertainty` the covariance of what was found. `flight` is the state that all of them share.
"""
