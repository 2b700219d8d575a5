"""What finds objects in frames: the two-stage detector for static cameras, and any user's model on whole frames."""
