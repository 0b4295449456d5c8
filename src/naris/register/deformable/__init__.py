"""Registration where no CT exists: a mean anatomy, whose shape is estimated with the pose of the camera."""
